"""`air-router new` makes what can be checked and flown, from options or answers."""

import io
import re
import sys
from types import SimpleNamespace

import pytest

from air_router.cli.cli import main
from air_router.mission.loading import load_mission
from air_router.mission.team import finders
from sitl.world.world_file import load_world

HOME = "47.3977,8.5456"


@pytest.mark.parametrize(
    ("robots", "altitude", "found"),
    [
        ("a", "30", {"a": "/pose"}),
        ("a=ros1, b=ros2, c", "45", {"a": "/fix", "b": "/odom", "c": "/pose"}),
        ("a=ros2, b=ros2", "45", {"a": "/odom", "b": "/odom"}),
        (" ".join(f"r{n}" for n in range(20)), "30", {f"r{n}": "/pose" for n in range(20)}),
    ],
)
def test_what_it_makes_is_in_order(robots, altitude, found, tmp_path, capsys):
    options = ["--home", HOME, "--robots", robots, "--altitude", altitude]
    folder = tmp_path / "made"
    assert main(["new", str(folder), *options, "--uav", "bird"]) == 0
    mission = load_mission(folder / "mission.yaml")
    assert {name: topic.name for name, topic in finders(mission).items()} == found
    assert (mission.uav, mission.altitude_above_home_m) == ("bird", float(altitude))
    assert mission.accepts == (("rtl_altitude",) if altitude == "45" else ())
    plans = load_world(mission.world, mission, tuple(found), seed=1).patrols
    assert all(len(plan.patrol.stops) == 4 for plan in plans.values())
    printed = capsys.readouterr()
    assert sorted(printed.out.split()) == sorted(map(str, folder.iterdir()))
    rovers = " ".join(f"--rover {name}=ipc:///tmp/{name}" for name in found)
    assert f"air-router sim {folder}/mission.yaml {rovers}\n" in printed.err
    programs = re.findall(r"python \S+/rover_\w+.py (\S+) \S+\n", printed.err)
    assert len(programs) == len({*programs}) == len(found)  # a DDS domain for each
    bridges = re.findall(r"mocha-link bridge ros2 --node \S+ --domain (\d+)\n", printed.err)
    assert bridges == [program for program in programs if program.isdigit()]
    for file in folder.glob("*.py"):
        assert "titan" not in file.read_text()


class Terminal(io.StringIO):
    """What a user types."""

    def isatty(self):
        return True


def test_it_prompts_on_a_terminal_until_it_can_read_the_answer(tmp_path, monkeypatch, capsys):
    given = [str(tmp_path / "prompted"), "", "147,8", HOME, "", "", "on", "husky=ros1"]
    monkeypatch.setattr(sys, "stdin", Terminal("".join(f"{line}\n" for line in given)))
    assert main(["new"]) == 0
    out, printed = capsys.readouterr()
    assert re.findall(r"Folder|Where|Cruise|Name|Robots", out) == [
        *("Folder", "Where", "Where", "Where", "Cruise", "Name", "Robots", "Robots")
    ]
    assert "latitude 147.0 is not within" in printed
    assert "'on' is no name" in printed
    assert load_mission(tmp_path / "prompted" / "mission.yaml").seek == ("husky",)


def test_nothing_is_overwritten_or_made_of_wrong_answers(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: False))
    folder = tmp_path / "made"
    assert main(["new", str(folder)]) == 2
    assert "pass --home" in capsys.readouterr().err
    for options in (["--robots", "a=ros3"], ["--robots", "a,a"], ["--altitude", "1"]):
        assert main(["new", str(folder), "--home", HOME, *options]) == 2
    assert main(["new", str(folder), "--home", HOME, "--uav", "rover"]) == 2
    assert not folder.exists()
    folder.mkdir()
    (folder / "team.yaml").write_text("mine")
    assert main(["new", str(folder), "--home", HOME]) == 2
    assert [(file.name, file.read_text()) for file in folder.iterdir()] == [("team.yaml", "mine")]
