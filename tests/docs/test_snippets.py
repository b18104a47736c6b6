"""Every command and snippet of README and docs is run, loaded or parsed; none is passed over.

`make docs-test` runs what takes longer: the tutorial with its flight (walk_tutorial.py), and what
else flies or serves (walk_commands.py).
"""

from __future__ import annotations

import functools
import json
import re
import shutil
import tomllib
from pathlib import Path

import click
import pytest
import yaml

import air_router.cli.cli
import mocha_link.cli.cli
import sitl.cli.cli
from air_router.control.command_request import MAX_BYTES, command_request_of
from air_router.messages import PathMessage, PoseMessage, SightingsMessage
from air_router.mission.loading import load_mission
from air_router.report.flight_table import COLUMNS
from mocha_link.service.requests import parse
from mocha_link.team.document import Document
from mocha_link.team.team import Team
from sitl.experiment.plan_file import load_experiment
from tests.command_lines import commands_of, context_of
from tests.docs.blocks import PAGES, PROGRAMS, ROOT, blocks, simple_commands

ALL = {block.name: block for block in blocks()}
MODULES = dict(zip(PROGRAMS, (air_router.cli.cli, mocha_link.cli.cli, sitl.cli.cli), strict=True))
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]

RUN_BY = {  # snippets that need something around them: the test that runs each
    "README.md python 1": "test_readme.py::test_the_snippet_runs",
    "control.md python 1": "air_router/control/test_control.py::test_what_the_docs_show_is_done",
    "control.md python 2": "air_router/control/test_one_endpoint.py::test_the_planner_of_the_docs",
    "editing.md python 1": "air_router/test_docs_routes.py::test_the_snippet_runs",
    "embedding.md python 1": "mocha_link/test_docs_embedding.py::test_the_planner_meets_everybody",
    "embedding.md python 2": (
        "mocha_link/test_docs_embedding.py::"
        "test_the_planner_of_another_language_needs_nothing_of_ours"
    ),
    "embedding.md python 3": "mocha_link/test_docs_embedding.py::test_the_radio_of_a_program",
    "embedding.md text 1": "mocha_link/test_docs_embedding.py::test_the_reports_are_reports",
    "embedding.md yaml 1": "mocha_link/test_docs_embedding.py::test_the_team_has_radios",
    "embedding.md 5": "mocha_link/test_docs_embedding.py::test_the_team_has_radios",
    "mission-file.md yaml": (
        "air_router/files/missions/test_mission_file.py::"
        "test_the_documented_examples_load_and_the_table_has_every_key"
    ),
    "records.md 4": "air_router/record/test_replay.py::test_the_snippet_of_the_docs_runs",
    "robot.md python": "system/test_rovers.py::test_rovers_of_three_kinds_are_found",
    "ros.md python 1": "mocha_link/bridges/test_docs.py::test_the_program",
    "ros.md python 2": "mocha_link/bridges/test_docs.py::test_values",
    "seeking.md python 1": "air_router/test_seek_policy_kit.py::test_the_docs_show_the_template",
    "seeking.md python 2": "air_router/test_seek_policy_kit.py::test_the_docs_show_the_kit",
    "state-machine.md mermaid": (
        "air_router/controller/test_state_table.py::test_the_diagrams_in_the_docs_are_those_drawn_from_the_table"
    ),
    "team-file.md yaml": "mocha_link/test_docs_embedding.py::test_the_examples_are_teams",
}
NO_SNIPPET = {  # pictures, formulas and what programs print
    "architecture.md 1": "who imports whom; tests/test_house.py sees to it",
    "editing.md 7": "printed by the command above it, shortened",
    "errors.md 1": "printed; every code: tests/test_errors.py",
    "embedding.md 3": "PromQL; its metrics: tests/mocha_link/service/test_prometheus.py",
    "mission-file.md 2": "printed; its codes: below",
    "seeking.md 1": "a formula",
    "seeking.md 2": "a formula",
    "sync-protocol.md 1": "who sends what when",
    "sync-protocol.md 2": "a frame; tests/mocha_link/test_second_puller.py",
    "sync-protocol.md 3": "a frame; tests/mocha_link/test_second_puller.py",
    "usual-values.md 1": "printed; every band: tests/air_router/files/test_usual_values.py",
    "watching.md 1": "what is printed; its parts: air_router/test_status.py",
    "watching.md 2": "what is printed; its columns: below",
    "simulation.md 3": "printed by `sitl team`, shortened",
    "control.md cpp 1": "needs a compiler and cppzmq; its request: below",
}
FOREIGN = {  # first words of commands that are not ours
    "dask": "dask.distributed, the extra `cluster`",
    "roscore": "ROS 1",
    "roslaunch": "ROS 1",
    "rostopic": "ROS 1",
    "scp": "OpenSSH",
    "colcon": "builds ROS 2 packages",
    "rerun": "opens records",
    "ros2": "ROS 2",
    "export": "",
    "CHECKOUT_UNDER_TEST=OLD": "needs another checkout (evidence/rehearsal.md)",
    "MOCHA_WORKSPACE=CATKIN_WS": "needs ROS 1; starts tests/system/test_live_original.py",
    "while": "a shell loop with a radio's own program",
    "do": "",
    "done": "",
    "sleep": "",
    "echo": "",
    "java": "Rajant's program",
    "ncat": "",
    **dict.fromkeys(("apt", "useradd", "install", "chown", "cp", "cd", "git"), "Linux"),
    **dict.fromkeys(("systemctl", "systemd-tmpfiles", "journalctl"), "systemd"),
    "docker": "install.md",
    "dtoverlay=uart0-pi5,ctsrts": "a line of a Raspberry Pi's config.txt",
    "radio:": "a line of a team file (embedding.md)",
    "source": "",
    "PX4_HOME_LAT=39.9421523": "PX4's own build",
    ".": "a virtual environment's own script",
    "sed": "run by walk_tutorial.py",
    "gdal_translate": "GDAL makes MBTiles (editing.md)",
    "gdaladdo": "",
    "sqlite3": "",
}
RUN_IN = ("new", "check", "plan", "convert", "cover", "keys", "import", "town", "completion")


def elsewhere(block):
    return {block.name, block.name.rpartition(" ")[0]} & {*RUN_BY, *NO_SNIPPET}


def command_blocks():
    return [
        b for b in ALL.values() if b.commands and not {b.name, b.name[:-2]} & {*RUN_BY, *NO_SNIPPET}
    ]


def test_who_runs_a_snippet_exists():
    for name, test in RUN_BY.items():
        assert any(block in {name, f"{name} 1"} for block in ALL), name
        file, _, function = test.partition("::")
        source = (ROOT / "tests" / file).read_text(encoding="utf-8")
        assert f"def {function}(" in source, test
        assert name.split(".md")[0] in source.replace("README", "README.md"), test
    assert NO_SNIPPET.keys() <= ALL.keys()


def test_no_snippet_is_passed_over():
    loaded = {"yaml", "json", "csv", "python", "sh", "ini", ""}
    for block in ALL.values():
        assert elsewhere(block) or block.language in loaded, (
            f"{block.page}:{block.line}: who checks this?"
        )


def shape(words):
    """A usage line as a command: brackets and what is in them taken away."""
    return [word for word in words if not word.startswith("[")]


def test_every_command_line_can_be_parsed():
    for block in command_blocks():
        assert parsed_in(block), block.name


def parsed_in(block):
    """How many commands of a block are commands; fails at one that is none."""
    parsed = 0
    for line in block.commands:
        if line.startswith(("home ", "rally ", "PX4 return ")):
            continue  # vehicle.md: what the command above prints
        if line.startswith("{"):
            json.loads(line if line.endswith("}") else block.text.partition("\n\n")[2])
            parsed += 1
            continue
        if line.startswith('"points"'):
            continue
        line = re.sub(r"\[[^\]]*\]", "", line)  # noqa: PLW2901 - what may be left out
        line = re.sub(r"<\((.*?)\)", r"; \1", line)  # noqa: PLW2901
        for words in simple_commands(line):
            check(without_sudo(words), f"{block.page}:{block.line}: {line}")
            parsed += 1
    return parsed


def without_sudo(words):
    if words[0] != "sudo":
        return words
    return words[3:] if words[1] == "-u" else words[1:]


def check(words, where):
    """That a command is one."""
    first, *rest = words
    first = first.rpartition("/")[2] or first
    if first in PROGRAMS:
        try:
            context_of(MODULES[first].PROGRAM, rest)
        except click.exceptions.Exit:  # --help
            pass
        except click.UsageError as error:
            pytest.fail(f"{where}: {error.format_message()}")
    elif first == "make":
        assert {word for word in rest if "=" not in word} <= TARGETS, where
        for word in rest:
            if word.startswith("REHEARSE="):
                check(["sitl", "rehearse", "MISSION", *word.partition("=")[2].split()], where)
    elif first in {"python", "python3"} and rest[0] == "-m":
        ours = list(ROOT.glob(rest[1].replace(".", "/") + "*"))
        assert ours or rest[1] in {"venv", "pytest"}, where
    elif first == "python" and rest[0].endswith(".py"):
        page = Path(where.partition(":")[0]).read_text(encoding="utf-8")
        copied = ROOT / "air_router" / "start" / Path(rest[0]).name
        assert copied.exists() or f"Save it as `{rest[0]}`" in page, where
    elif first == "pip":
        extras = {e for extra in re.findall(r"\[([a-z0-9,]+)\]", where) for e in extra.split(",")}
        assert extras <= EXTRAS.keys(), where
    else:
        assert first in FOREIGN, f"{where}: no command of ours, and not in FOREIGN"


@functools.cache
def help_of(command):
    program, *names = command.split()
    for ctx in commands_of(MODULES[program].PROGRAM):
        if ctx.command_path.split() == [program, *names]:
            return ctx.get_help()
    raise KeyError(command)


def test_commands_named_in_the_text_exist():
    """`air-router sim --speed 10` within a sentence or a table: command and options."""
    for page in PAGES:
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for span in re.findall(r"`([^`\n]+)`", text):
            words = span.split()
            if words[0] not in PROGRAMS or len(words) < 2 or not re.fullmatch(r"[a-z]+", words[1]):
                continue
            if words[1] in {"udp", "message"}:  # what is signed (security.md), no command
                continue
            try:
                shown = help_of(" ".join(words[:2]))
            except KeyError:
                pytest.fail(f"{page.name}: `{span}`: no such command")
            if words[1] == "bridge":
                shown += "".join(help_of(f"mocha-link bridge {b}") for b in ("ros1", "ros2"))
            for option in re.findall(r"(?<=\s)--[a-z0-9-]+", span):
                assert re.search(rf"(?m)^\s+(-\w.*)?{option}\b", shown), f"{page.name}: `{span}`"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the files that examples name."""
    folder = tmp_path_factory.mktemp("docs")
    shutil.copytree(ROOT / "missions", folder / "missions", ignore=lambda *_: {"large"})
    files = ROOT / "tests" / "data" / "files"
    pennovation = ROOT / "missions" / "pennovation"
    shutil.copy(ROOT / "tests" / "data" / "pennovation.plan", folder / "town.plan")
    shutil.copy(files / "geozones_ed269.json", folder / "geozones.json")
    shutil.copy(files / "walk.gpx", folder)
    (folder / "field.geojson").write_text(ALL["editing.md json 1"].text)
    for name in ("mission.yaml", "team.yaml", "world.yaml"):
        shutil.copy(pennovation / name, folder / name)
    original = folder / "MOCHA" / "mocha_core" / "config"
    shutil.copytree(ROOT / "tests/data/mocha/upstream", original)
    robots = yaml.safe_load((original / "robot_configs.yaml").read_text()).values()
    radios = {
        robot["using-radio"]: {"MAC-address": [f"00:00:00:00:00:{number:02x}"]}
        for number, robot in enumerate(robots)
    }
    (original / "radio_configs.yaml").write_text(yaml.safe_dump(radios))
    return folder


RUN = [
    (block, line)
    for block in command_blocks()
    if block.page.name != "tutorial.md"  # walk_tutorial.py
    for line in block.commands
    if line.split()[0] in PROGRAMS and line.split()[1] in RUN_IN and " | " not in line
    if line != "air-router new"  # it prompts
    if ".mcap" not in line  # records: tests/air_router/record runs these
]


@pytest.mark.parametrize(("block", "line"), RUN, ids=[line for _, line in RUN])
def test_the_fast_ones_run(block, line, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    (words,) = simple_commands(line)
    for option in ("-o", "--out"):  # a second example may write the same file
        if option in words and words[1] != "town":
            Path(words[words.index(option) + 1]).unlink(missing_ok=True)
    assert MODULES[words[0]].main(words[1:]) == 0, capsys.readouterr().err


SHORTEST = ALL["mission-file.md yaml 1"].text
TOWN = "coordinates: local\nframe: {origin: [38.5, -98.5]}\nwaypoints: [[50, 50]]\n"


@pytest.mark.parametrize("line", range(3))
def test_seeking(line, tmp_path):
    policy = ALL["seeking.md yaml 1"].text.splitlines()[line]
    team = f"team: {ROOT / 'missions/pennovation/team.yaml'}\nuav: titan\n"
    (tmp_path / "mission.yaml").write_text(f"{SHORTEST}{team}{policy}\n")
    mission = load_mission(tmp_path / "mission.yaml")
    assert mission.seek_policy == ("rendezvous", "freshest", "round_robin")[line]


def test_several(tmp_path):
    text = ALL["concepts.md yaml 1"].text
    (tmp_path / "mission.yaml").write_text(f"{text}{TOWN}fence: null\nno_fly_zones: []\n")
    mission = load_mission(tmp_path / "mission.yaml")
    assert [layer.uav for layer in mission.layers] == ["titan", "atlas"]


def test_zone_files(folder):
    shutil.copy(ROOT / "tests/data/files/zones.kml", folder / "site.kml")
    (folder / "filed.yaml").write_text(SHORTEST + ALL["files.md yaml 1"].text)
    load_mission(folder / "filed.yaml")


def test_goals_by_gossip(tmp_path):
    team = Document.load(ROOT / "missions" / "pennovation" / "team.yaml").data
    added = yaml.safe_load(ALL["control.md yaml 2"].text)["kinds"]
    team["kinds"] |= {"base_station": added["base_station"]}
    team["kinds"]["aerial_robot"]["topics"] += added["aerial_robot"]["topics"]
    team["robots"]["basestation"] = {
        "kind": "base_station",
        "address": "10.0.0.9",
        "base_port": 25000,
        "clients": ["titan"],
    }
    team["robots"]["titan"]["clients"].append("basestation")
    (tmp_path / "team.yaml").write_text(yaml.safe_dump(team))
    assert "/goals" in {t.name for t in Team.load(tmp_path / "team.yaml").topics_of("basestation")}
    mission = f"{SHORTEST}team: team.yaml\nuav: titan\n{ALL['control.md yaml 1'].text}"
    (tmp_path / "mission.yaml").write_text(mission)
    assert load_mission(tmp_path / "mission.yaml").goals_from == ("basestation",)


def test_what_a_robot_publishes():
    published = json.loads(ALL["robot.md json 1"].text)
    models = {"/pose": PoseMessage, "/path": PathMessage, "/sightings": SightingsMessage}
    assert published.keys() == models.keys()
    for topic, message in published.items():
        assert message.keys() == models[topic].model_fields.keys()
        models[topic].decode(json.dumps(message).encode())


def test_the_request_in_other_languages():
    (text,) = re.findall(r'R"\((.*?)\)"', ALL["control.md cpp 1"].text)
    assert command_request_of(parse([text.encode()], MAX_BYTES)).request == "seek"


def test_an_experiment(tmp_path):
    file, space = (ALL[f"experiments.md yaml {number}"].text for number in (1, 2))
    (tmp_path / "mine.yaml").write_text(re.sub("space: .*", space, file))
    experiment, _ = load_experiment(str(tmp_path / "mine.yaml"))
    assert len(experiment.rows) == 4


def test_a_route(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    exec(compile(ALL["routes.md python 1"].text, "routes.md", "exec"), {})  # noqa: S102 - our own
    length_m, _, legs = capsys.readouterr().out.partition(" ")
    assert float(length_m) > 0
    assert "Point(" in legs


def test_a_route_of_another_planner(capsys):
    exec(compile(ALL["routes.md python 2"].text, "routes.md", "exec"), {})  # noqa: S102 - our own
    path, distance = capsys.readouterr().out.splitlines()
    assert path == "[(0, 0), (35, 52), (38, 55), (62, 55), (120, 0)] 171"
    assert distance.startswith("(5.0")
    assert distance.endswith("'hall')")


def test_what_check_prints_of_the_way_home(folder, capsys):
    printed = ALL["vehicle.md 1"].text.partition("\n\n")[2]
    mission = folder / "missions" / "pennovation" / "mission.yaml"
    mission.write_text(mission.read_text().replace("# endurance_s: 1800", "endurance_s: 1200"))
    assert air_router.cli.cli.main(["check", str(mission)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    for line in printed.splitlines():
        assert " ".join(line.removesuffix("...").split()) in out


def test_the_columns_at_the_end():
    """docs/watching.md shows the table that a flight ends with."""
    heads = ALL["watching.md 2"].text.splitlines()[0]
    assert re.split(r"  +", heads.strip()) == [*COLUMNS]


def test_printed_problems_have_codes():
    known = (ROOT / "docs" / "errors.md").read_text(encoding="utf-8")
    for name in ("errors.md 1", "mission-file.md 2"):
        for code in re.findall(r"\[([a-z-]+)\]$", ALL[name].text, re.MULTILINE):
            assert f"`{code}`" in known


def test_every_link_leads_somewhere():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for link, _, anchor in re.findall(r"\]\(([^)#\s]*)(#([^)]*))?\)", text):
            if link.startswith("http"):
                continue
            target = (page.parent / link) if link else page
            assert target.exists(), f"{page.name}: {link}"
            if anchor:
                heads = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.MULTILINE)
                slugs = {re.sub(r"[^\w -]", "", head).lower().replace(" ", "-") for head in heads}
                assert anchor in slugs, f"{page.name}: {link}#{anchor}"


def test_the_index_has_every_page_once():
    text = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    linked = re.findall(r"\]\(([a-z0-9-]+\.md)\)", text)
    pages = {page.name for page in PAGES if page.parent.name == "docs"} - {"index.md"}
    assert sorted(linked) == sorted(pages)
    evidence = (ROOT / "docs" / "evidence" / "index.md").read_text(encoding="utf-8")
    pages = {page.name for page in PAGES if page.parent.name == "evidence"} - {"index.md"}
    assert sorted(re.findall(r"\]\(([a-z0-9-]+\.md)\)", evidence)) == sorted(pages)
