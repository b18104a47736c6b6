"""Commands are imported when they are asked for, and the tables of them say what they are."""

import argparse
import dataclasses
import json
import os
import subprocess
import sys
import tomllib
import types
from importlib import metadata
from pathlib import Path

import pytest

import air_router.cli.cli
import mocha_link.cli.cli
import sitl.cli.cli
from mocha_link.cli.program import Command
from mocha_link.errors import install_command

ROOT = Path(__file__).parents[1]
MISSION = str(ROOT / "missions" / "pennovation" / "mission.yaml")
PROGRAMS = {
    "air-router": air_router.cli.cli,
    "mocha-link": mocha_link.cli.cli,
    "sitl": sitl.cli.cli,
}
TABLE = [(program, row) for program, cli in PROGRAMS.items() for row in cli.COMMANDS]
OURS = {"air_router", "geo", "mocha_link", "sitl"}


def asked(program, *words):
    """The program as it is after these words; what it says is on stdout or stderr."""
    try:
        return PROGRAMS[program].main([*words])
    except SystemExit as end:
        return end.code


def subcommands(parser):
    (action,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return action.choices


def test_a_command_is_of_its_program():
    for program, row in TABLE:
        assert row.module.split(".")[0] == PROGRAMS[program].__name__.split(".")[0]


@pytest.mark.parametrize("program", PROGRAMS)
def test_one_by_one_the_commands_say_the_same_as_all_at_once(program, capsys):
    whole = PROGRAMS[program].parser()
    assert asked(program, "--help") == 0
    assert capsys.readouterr().out == whole.format_help()
    for name, parser in subcommands(whole).items():
        assert asked(program, name, "--help") == 0
        assert capsys.readouterr().out == parser.format_help()
        assert asked(program, name, "--no-such-option") == 2
        told = capsys.readouterr().err
        with pytest.raises(SystemExit) as end:
            whole.parse_args([name, "--no-such-option"])
        assert (end.value.code, told) == (2, capsys.readouterr().err)


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize(
    "words", [["-v"], ["dance"], ["-v", "dance"], ["--log-level", "loud", "x"]]
)
def test_wrong_usage_is_told_the_same(program, words, capsys):
    assert asked(program, *words) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"usage: {program} ")
    with pytest.raises(SystemExit):
        PROGRAMS[program].parser().parse_args(words)
    assert told == capsys.readouterr().err


@pytest.mark.parametrize("program", PROGRAMS)
def test_without_a_command_there_is_the_list_of_them(program, capsys):
    assert asked(program) == 2
    assert capsys.readouterr().err == PROGRAMS[program].parser().format_help()


@pytest.mark.parametrize(
    ("program", "missing", "words", "told"),
    [
        ("air-router", "aiohttp", ["edit", MISSION], "the page needs aiohttp"),
        ("air-router", "matplotlib", ["check", MISSION, "--png", "x.png"], "a picture needs"),
        ("air-router", "pymavlink", ["sim", MISSION], "the simulated world needs pymavlink"),
        (
            "air-router",
            "foxglove",
            ["fly", MISSION, "--foxglove", "--no-record"],
            "--foxglove needs",
        ),
        ("air-router", "cyclonedds", ["ros2"], "ROS 2 needs cyclonedds"),
        ("mocha-link", "cyclonedds", ["bridge", "ros2", "--node", "ipc:///none"], "needs cyclon"),
        ("mocha-link", "shtab", ["completion", "bash"], "completion needs shtab"),
        ("sitl", "pymavlink", ["vehicle"], "the simulator needs pymavlink"),
        ("sitl", "scipy", ["experiment", "table1"], "an experiment needs scipy"),
    ],
)
def test_a_missing_extra_ends_with_7_and_the_command_that_installs_it(
    program, missing, words, told, tmp_path
):
    """Every other command works without it: they are all there until one is asked for."""
    code = (
        f"import sys; sys.modules[{missing!r}] = None\n"
        f"from {PROGRAMS[program].__name__} import main\nsys.exit(main(sys.argv[1:]))\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", code, *words]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 7
    assert told in done.stderr
    assert "; run: pip install " in done.stderr.splitlines()[-1]


class Installed:
    """A distribution whose files say that it came from `url`."""

    def __init__(self, url, *, editable):
        self.origin = {"url": url, "dir_info": {"editable": editable}}
        self.requires = ["lz4>=4.4", 'pynacl>=1.5; extra == "keys"', "aiohttp; extra == 'web'"]

    def read_text(self, name):
        assert name == "direct_url.json"
        return json.dumps(self.origin)


def test_the_command_names_the_checkout_or_wheel_that_was_installed(monkeypatch, tmp_path):
    wheel = tmp_path / "a b.whl"
    wheel.touch()
    known = {
        "air-router": Installed(tmp_path.as_uri(), editable=True),
        "mocha-link": Installed(wheel.as_uri(), editable=False),
    }
    monkeypatch.setattr(metadata, "distribution", known.__getitem__)
    assert install_command("web", "air-router") == f"pip install -e '{tmp_path}[web]'"
    assert install_command("keys") == f"pip install '{wheel}[keys]'"
    wheel.unlink()
    assert install_command("keys") == "pip install 'pynacl>=1.5'"


def loaded(program, *words):
    """What a fresh interpreter has imported when the program has done this."""
    script = (
        f"import json, sys\nfrom {PROGRAMS[program].__name__} import main\n"
        "try: main(sys.argv[1:])\n"
        "except SystemExit as end: assert not end.code\n"
        "json.dump([*sys.modules], sys.stderr)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, *words], capture_output=True, text=True, check=True
    )
    return set(json.loads(done.stderr.splitlines()[-1]))


@pytest.mark.parametrize("program", PROGRAMS)
def test_what_only_the_program_says_needs_only_python(program):
    found = loaded(program, "--help")
    assert not {row.module for row in PROGRAMS[program].COMMANDS} & found
    assert not {"numpy", "pydantic", "yaml", "zmq", "shapely", "pyproj"} & found
    assert len([name for name in found if name.split(".")[0] in OURS]) < 20


VEHICLE = {"mavsdk", "pymavlink"}
EXTRAS = {"aiohttp", "foxglove", "matplotlib", "pyulog", "rerun", "rosbags", "scipy", "shtab"}


@pytest.mark.parametrize(
    ("words", "unneeded"),
    [
        ("air-router check --help", EXTRAS | VEHICLE | {"networkx", "zmq", "mcap"}),
        ("air-router ask --help", EXTRAS | VEHICLE | {"shapely", "networkx", "yaml", "mcap"}),
        ("air-router fly --help", EXTRAS | {"pymavlink", "networkx"}),
        ("mocha-link node --help", EXTRAS | VEHICLE | {"shapely", "pyproj"}),
        ("sitl experiment --help", EXTRAS | VEHICLE | {"zmq", "mcap"}),
    ],
)
def test_a_command_imports_what_it_needs(words, unneeded):
    found = loaded(*words.split())
    assert not {name.split(".")[0] for name in found} & unneeded


INTERRUPT = """
import os, runpy, signal, sys

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == imported:
            os.kill(os.getpid(), signal.SIGINT)

module, imported, *words = sys.argv[1:]
sys.meta_path.insert(0, Interrupt())
signal.signal(signal.SIGINT, signal.default_int_handler)  # the shell may have us ignore it
main = runpy.run_module(module, run_name="imported")["main"]
sys.argv = [module, *words]
sys.exit(main())
"""


@pytest.mark.parametrize(
    ("module", "imported", "words"),
    [
        ("air_router.__main__", "argparse", "check x.yaml"),
        ("mocha_link.cli.cli", "pydantic", "check x.yaml"),
        ("sitl.cli.cli", "pymavlink", "vehicle"),
    ],
)
def test_ctrl_c_while_a_command_is_imported_is_one_line(module, imported, words):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPT, module, imported, *words.split()],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


@pytest.mark.parametrize("program", PROGRAMS)
def test_ctrl_c_while_a_command_runs_is_one_line(program, capsys, monkeypatch):
    def run(_arguments):
        raise KeyboardInterrupt

    def add_arguments(_parser):
        pass

    row = Command("stand-in", "stand_in", "stands in")
    monkeypatch.setitem(
        sys.modules, "stand_in", types.SimpleNamespace(add_arguments=add_arguments, run=run)
    )
    cli = PROGRAMS[program]
    monkeypatch.setattr(cli, "PROGRAM", dataclasses.replace(cli.PROGRAM, commands=(row,)))
    assert asked(program, "stand-in") == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_the_installed_programs_are_those_that_take_an_interrupt_from_the_first_import_on():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    modules = {
        name: f"{cli.__name__.split('.')[0]}.__main__:main" for name, cli in PROGRAMS.items()
    }
    assert project["project"]["scripts"] == modules
