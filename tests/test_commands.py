"""Commands are imported when they are asked for, and the tables of them say what they are."""

import argparse
import dataclasses
import json
import subprocess
import sys
import tomllib
import types
from pathlib import Path

import pytest

import air_router.cli.cli
import mocha_link.cli.cli
import sitl.cli.cli
from mocha_link.cli.program import Command

ROOT = Path(__file__).parents[1]
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
@pytest.mark.parametrize("words", [[], ["dance"], ["-v", "dance"], ["--log-level", "loud", "x"]])
def test_wrong_usage_is_told_the_same(program, words, capsys):
    assert asked(program, *words) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"usage: {program} ")
    with pytest.raises(SystemExit):
        PROGRAMS[program].parser().parse_args(words)
    assert told == capsys.readouterr().err


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
EXTRAS = {"aiohttp", "distributed", "matplotlib", "scipy", "pyulog", "pyarrow", "rosbags", "shtab"}


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
