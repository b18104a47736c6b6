"""Commands are imported when they are run, and the tables of them describe each."""

import json
import os
import subprocess
import sys
import tomllib
import types
from functools import cache
from importlib import metadata
from pathlib import Path

import pytest

import air_router.cli.cli
import mocha_link.cli.cli
import sitl.cli.cli
from mocha_link.cli import command, options_of
from mocha_link.errors import install_command
from tests.command_lines import commands_of, context_of
from tests.imports import imports_in, late_homes

ROOT = Path(__file__).parents[1]
MISSION = str(ROOT / "missions" / "pennovation" / "mission.yaml")
PROGRAMS = {
    "air-router": air_router.cli.cli,
    "mocha-link": mocha_link.cli.cli,
    "sitl": sitl.cli.cli,
}
TABLE = [(name, module) for name, cli in PROGRAMS.items() for module, _ in cli.COMMANDS.values()]
OURS = {"air_router", "geo", "mocha_link", "sitl"}


def exit_code(program, *arguments):
    """The exit code of a program; its output is on stdout or stderr."""
    try:
        return PROGRAMS[program].main([*arguments])
    except SystemExit as end:
        return end.code


def test_a_command_is_of_its_program():
    for program, module in TABLE:
        assert module.split(".")[0] == PROGRAMS[program].__name__.split(".")[0]


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_command_has_help_and_names_its_mistakes(program, capsys):
    for ctx in commands_of(PROGRAMS[program].PROGRAM):
        path = ctx.command_path.split()[1:]
        assert exit_code(program, *path, "--help") == 0
        assert capsys.readouterr().out.startswith(f"Usage: {program} {' '.join(path)} ")
        assert exit_code(program, *path, "--verbos") == 2
        first, second = capsys.readouterr().err.splitlines()
        assert first.startswith(f"{ctx.command_path}: error: No such option '--verbos'.")
        assert "'--verbose'" in first  # the nearest, with others that are near
        assert second == f"`{ctx.command_path} --help` shows its usage"


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize(
    "arguments", [["-v"], ["dance"], ["-v", "dance"], ["--log-level", "loud", "x"]]
)
def test_wrong_usage_is_two_lines(program, arguments, capsys):
    assert exit_code(program, *arguments) == 2
    printed = capsys.readouterr().err
    assert printed.startswith(f"{program}: error: ")
    assert printed.endswith(f"\n`{program} --help` shows its usage\n")
    assert printed.count("\n") == 2


@pytest.mark.parametrize(
    ("line", "near"),
    [("air-router chek", "check"), ("mocha-link nod", "node"), ("sitl tawn", "town")],
)
def test_for_a_misspelt_command_the_nearest_is_suggested(line, near, capsys):
    assert exit_code(*line.split()) == 2
    assert f"Did you mean '{near}'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    [
        "air-router fly m.yaml --arm --resume",
        "air-router sim m.yaml --log-dir d --no-record",
        "air-router tiles fetch f --url u --attribution a --mission m --bounds 1,2,3,4",
        "sitl vehicle m.yaml --home 47,8,400",
    ],
)
def test_options_that_contradict_each_other_are_wrong_usage(line, capsys):
    assert exit_code(*line.split()) == 2
    assert "contradict each other" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "option"),
    [
        ("air-router fly m.yaml --team --arm", "--team"),
        ("sitl experiment e --rows --seeds 5", "--rows"),
        ("mocha-link node t.yaml --robot", "--robot"),
    ],
)
def test_an_option_is_no_value_of_another(line, option, capsys):
    assert exit_code(*line.split()) == 2
    assert f"Option '{option}' requires an argument" in capsys.readouterr().err


def read(line):
    """What a program reads from a line."""
    program, *arguments = line.split()
    return options_of(context_of(PROGRAMS[program].PROGRAM, arguments))


def test_an_option_can_take_several_values_until_the_next():
    assert read("sitl experiment e --rows a=1 b=2 --seeds 5").rows == ("a=1", "b=2")
    assert read("mocha-link import r.yaml --ours io titan -o t").ours == ("io", "titan")
    assert read("sitl experiment e").rows == ()


def test_a_place_in_the_south_is_a_value():
    assert read("air-router ask goto -33.9,151.2").words == ("goto", " -33.9,151.2")
    assert read("air-router new --home -33.9,151.2").home == (-33.9, 151.2)
    assert read("air-router ask altitude -5").words == ("altitude", " -5")


def test_an_option_whose_value_may_be_left_out():
    assert read("air-router sim m.yaml").web is None
    assert read("air-router sim m.yaml --web --json").web == 8425
    assert read("air-router sim --web 0 m.yaml").web == 0
    assert read("air-router sim m.yaml --px4").px4 == ""
    assert read("air-router sim m.yaml --px4 ~/PX4").px4 == "~/PX4"
    control = read("air-router sim m.yaml --control").control
    assert control.startswith("ipc:///")
    assert control.endswith("/mocha-link/flight")
    assert read("air-router sim m.yaml --foxglove").foxglove == ("127.0.0.1", 8765)


@pytest.mark.parametrize("program", PROGRAMS)
def test_without_a_command_there_is_the_list_of_them(program, capsys):
    assert exit_code(program) == 2
    printed = capsys.readouterr().err
    assert exit_code(program, "--help") == 0
    assert capsys.readouterr().out == printed


MISSING = [  # the program, what is not installed, the command, the message
    ("air-router", "aiohttp", ["edit", MISSION], "the page needs aiohttp"),
    ("air-router", "matplotlib", ["check", MISSION, "--png", "x.png"], "a picture needs"),
    ("air-router", "matplotlib", ["report", "x.mcap"], "a picture needs matplotlib"),
    ("air-router", "jinja2", ["report", "x.mcap"], "a report needs jinja2"),
    ("air-router", "pymavlink", ["sim", MISSION], "the simulated world needs pymavlink"),
    ("air-router", "foxglove", ["fly", MISSION, "--foxglove", "--no-record"], "--foxglove needs"),
    ("air-router", "cyclonedds", ["ros2"], "ROS 2 needs cyclonedds"),
    ("mocha-link", "cyclonedds", ["bridge", "ros2", "--node", "ipc:///none"], "needs cyclon"),
    ("sitl", "pymavlink", ["vehicle"], "the simulator needs pymavlink"),
    ("sitl", "scipy", ["experiment", "table1"], "a world with ways for its robots needs scipy"),
]
WITHOUT = """
import importlib, json, os, sys, tempfile
import air_router.cli.check, air_router.cli.edit, air_router.cli.fly, air_router.sim.sim  # once

for module, missing, arguments in json.loads(sys.argv[1]):
    with tempfile.TemporaryFile() as output:
        child = os.fork()
        if not child:
            os.dup2(2, 1), os.dup2(output.fileno(), 2)
            sys.modules[missing] = None
            os._exit(importlib.import_module(module).main(arguments))
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        output.seek(0)
        print(json.dumps([code, output.read().decode()]), flush=True)
"""


def test_a_missing_extra_ends_with_7_and_the_command_that_installs_it(tmp_path):
    """Every other command works without it: they are all there until one is run."""
    cases = [(PROGRAMS[program].__name__, *case) for program, *case, _ in MISSING]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, json.dumps(cases)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    for line, (*_, message) in zip(done.stdout.splitlines(), MISSING, strict=True):
        code, printed = json.loads(line)
        assert (code, message in printed) == (7, True), printed
        assert "; run: pip install " in printed.splitlines()[-1]


def test_the_error_of_a_robot_s_own_program_names_the_extra_too():
    script = "import sys; sys.modules['cyclonedds'] = None; import mocha_link.bridges.dds"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    error = done.stderr.splitlines()[-1]
    assert error.startswith("mocha_link.errors.MissingExtraError: ROS 2 needs cyclonedds, ")
    assert "; run: pip install " in error


class Installed:
    """A distribution with metadata that it came from `url`."""

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


def test_what_only_the_program_prints_needs_only_python():
    script = (
        "import json, sys\nfrom {} import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
    )
    for cli in PROGRAMS.values():
        code = script.format(cli.__name__) + "json.dump([*sys.modules], sys.stderr)"
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        found = set(json.loads(done.stderr))
        assert not {module for module, _ in cli.COMMANDS.values()} & found
        assert not {"numpy", "pydantic", "yaml", "zmq", "shapely", "pyproj"} & found
        assert len([name for name in found if name.split(".")[0] in OURS]) < 20


def test_a_check_loads_only_what_it_needs():
    """Also of the simulated world, whose file it checks."""
    mission = ROOT / "missions" / "pennovation" / "mission.yaml"
    code = (
        "import json, sys\nfrom air_router.cli.cli import main\n"
        f"main(['check', {str(mission)!r}])\n"
        "json.dump([*sys.modules], sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found = set(json.loads(done.stderr))
    assert "sitl.world.world_file" in found
    assert not {"networkx", "scipy", "mavsdk", "pymavlink", "aiohttp", "matplotlib"} & found
    assert not {"sitl.team.nodes", "sitl.px4sim", "air_router.record", "multiprocessing"} & found


def file_of(module):
    path = ROOT / module.replace(".", "/")
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


@cache
def names_in(module):
    """What a module of ours imports when it is imported; None if it is not a module."""
    path = file_of(module)
    if not path.exists():
        return None
    names = {module.rpartition(".")[0]} - {""}
    for source, name in imports_in(path.read_text(encoding="utf-8"), deep=False):
        home = late_homes(file_of(source)).get(name, source)
        names |= {source} if name is None else {source, home, f"{home}.{name}"}
    return names


def imported(module):
    """Packages of others that are imported with it, by whichever module of ours."""
    seen, waiting = set(), {module}
    while waiting:
        name = waiting.pop()
        seen.add(name)
        more = names_in(name) if name.split(".")[0] in OURS else None
        waiting |= (more or set()) - seen
    return {name.split(".")[0] for name in seen} - OURS


VEHICLE = {"mavsdk", "pymavlink"}
EXTRAS = {"aiohttp", "foxglove", "jinja2", "matplotlib", "rosbags", "scipy"}


@pytest.mark.parametrize(
    ("module", "needed", "unneeded"),
    [
        ("air_router.cli.check", {"shapely"}, EXTRAS | VEHICLE | {"networkx", "zmq", "mcap"}),
        ("air_router.cli.report", {"mcap"}, EXTRAS | VEHICLE),
        ("air_router.cli.ask", {"zmq"}, EXTRAS | VEHICLE | {"shapely", "networkx", "yaml", "mcap"}),
        ("air_router.cli.fly", {"mavsdk"}, EXTRAS | {"pymavlink", "networkx"}),
        ("mocha_link.cli.node_command", {"zmq"}, EXTRAS | VEHICLE | {"shapely", "pyproj"}),
        ("sitl.cli.experiment_command", set(), EXTRAS | VEHICLE | {"zmq", "mcap"}),
    ],
)
def test_a_command_imports_what_it_needs(module, needed, unneeded):
    found = imported(module)
    assert needed <= found
    assert not unneeded & found


INTERRUPT = """
import os, runpy, signal, sys

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == imported:
            os.kill(os.getpid(), signal.SIGINT)

module, imported, *arguments = sys.argv[1:]
sys.meta_path.insert(0, Interrupt())
signal.signal(signal.SIGINT, signal.default_int_handler)  # the shell may have us ignore it
main = runpy.run_module(module, run_name="imported")["main"]
sys.argv = [module, *arguments]
sys.exit(main())
"""


@pytest.mark.parametrize(
    ("program", "imported", "arguments"),
    [
        ("air-router", "click", "check x.yaml"),
        ("mocha-link", "pydantic", "check x.yaml"),
        ("sitl", "pymavlink", "vehicle"),
    ],
)
def test_ctrl_c_while_a_command_is_imported_is_one_line(program, imported, arguments):
    checkout = Path(os.environ.get("CHECKOUT_UNDER_TEST", ROOT))  # as in tests/system
    project = tomllib.loads((checkout / "pyproject.toml").read_text(encoding="utf-8"))
    module = project["project"]["scripts"][program].partition(":")[0]
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPT, module, imported, *arguments.split()],
        cwd=checkout,  # what it imports is there
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


@pytest.mark.parametrize("program", PROGRAMS)
def test_ctrl_c_while_a_command_runs_is_one_line(program, capsys, monkeypatch):
    @command("Stand in.")
    def run(_options):
        raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "stand_in", types.SimpleNamespace(run=run))
    monkeypatch.setitem(PROGRAMS[program].PROGRAM.table, "stand-in", ("stand_in", "stand in"))
    assert exit_code(program, "stand-in") == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_the_installed_programs_are_those_that_take_an_interrupt_from_the_first_import_on():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    modules = {
        name: f"{cli.__name__.split('.')[0]}.__main__:main" for name, cli in PROGRAMS.items()
    }
    assert project["project"]["scripts"] == modules


def test_commands_that_lack_an_extra_are_completed_by_name():
    """And what needs the extra reports so when it is run, not while a line is typed."""
    code = (
        "import sys\nsys.modules['pymavlink'] = None\nimport sitl.cli.cli\n"
        "sys.exit(sitl.cli.cli.main())"
    )
    for line, found in (("sitl veh", "plain,vehicle"), ("sitl vehicle --ho", "")):
        completion = {"_SITL_COMPLETE": "bash_complete", "COMP_WORDS": line, "COMP_CWORD": "1"}
        completion["COMP_CWORD"] = str(len(line.split()) - 1)
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, **completion},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stdout.strip(), done.stderr) == (0, found, "")


def checked_without(tmp_path, missing, mission):
    """Where an extra is not installed."""
    (tmp_path / "sitecustomize.py").write_text(f"import sys\nsys.modules[{missing!r}] = None\n")
    done = subprocess.run(
        [sys.executable, "-m", "air_router", "check", f"{ROOT}/missions/{mission}/mission.yaml"],
        env={**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "waypoints" in done.stdout
    return done.stderr


def test_a_mission_is_checked_where_its_world_cannot_be(tmp_path):
    """The world's program may lack an extra on a companion."""
    note = checked_without(tmp_path, "scipy", "explorers")
    assert "needs scipy, which is not installed" in note
    assert note.startswith("the world file is not checked: ")


def test_a_world_file_is_checked_where_nothing_can_be_simulated(tmp_path):
    assert checked_without(tmp_path, "pymavlink", "pennovation") == ""
