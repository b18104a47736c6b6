"""Mistakes that newcomers make: each gets one clear answer and the exit code of the docs."""

import os
import shutil
import socket
from pathlib import Path

import pytest

import mocha_link.cli.cli
from air_router.cli.cli import main

ROOT = Path(__file__).parents[3]
HOME = "[39.9421523, -75.1997644]"

IN_FILES = [  # what is changed in the mission, the command, the message
    ("", "check nope.yaml", "nope.yaml:1:1: cannot read the file: No such file"),
    ("", "check .", ".:1:1: cannot read the file: Is a directory"),
    ("", "check team.yaml", "team.yaml:15:1: this is a team file: name the mission"),
    ("", "check mission.yaml --uav io", "'io' is of kind ground_robot in the team file"),
    ("", "check rovers/town.plan", "the kind aerial_robot in rovers/team.yaml"),
    ("", "check walk.gpx", "walk.gpx:1:1: cannot be flown directly: first `air-router convert"),
    ("", "edit walk.gpx --no-open --port 0", "walk.gpx:1:1: cannot be flown directly: first"),
    ("", "check there.kml", "there.kml:1:1: a file of zones is no mission"),
    ("", "replay mission.yaml", "mission.yaml: not an MCAP file"),
    ("speed_m_s|speed_ms", "check mission.yaml", "'speed_ms'; did you mean 'speed_m_s'?"),
    (f"{HOME}|[-75.1997644, 39.9421523]", "check mission.yaml", "home is 14963 km from every"),
    (
        "altitude_m: 40|altitude_m: high",
        "check mission.yaml",
        "mission.yaml:19:13: 'altitude_m' must be a number",
    ),
    ("home:|home: [", "check mission.yaml", "[not-yaml]"),
    (
        "team: team.yaml|team: tema.yaml",
        "check mission.yaml",
        "there is no file tema.yaml; did you mean 'team.yaml'?",
    ),
    ("seek: [|seek: [jo, ", "check mission.yaml", "[unknown-robot]"),
]
IN_USAGE = [
    ("", "fly a mission in simulation"),
    ("dance", "No such command 'dance'"),
    ("plan mission.yaml --from 0 --to 99", "no waypoint 99; Pennovation has 1 to 39"),
    ("plan mission.yaml --from 1 --to here", "here is neither a waypoint's number nor LATITUDE"),
    ("plan mission.yaml --from 1 --to 1,2,3", "1,2,3 is neither a waypoint's number nor"),
    ("plan mission.yaml --from 1 --to 1.5", "1.5 is neither a waypoint's number nor LATITUDE"),
    ("plan mission.yaml --from -75.2,39.942 --to 1", "latitude comes first: 39.942,-75.2"),
    ("plan mission.yaml --from 1 --to 40.9,-75.2", "is 106 km from home; correct it"),
    ("plan mission.yaml --from 1 --to 91,0", "--to: latitude 91.0 is not within"),
    ("sim mission.yaml --speed fast", "fast is not a speed between 0.1 and 100"),
    ("sim mission.yaml --speed nan", "nan is not a speed between 0.1 and 100"),
    ("sim mission.yaml --duration 0", "0 is not a positive number of seconds"),
    ("fly mission.yaml --duration soon", "soon is not a positive number of seconds"),
    ("fly mission.yaml --sysid 300", "300 is not a system id of a vehicle, 1 to 250"),
    ("fly mission.yaml --sysid 0", "0 is not a system id of a vehicle, 1 to 250"),
    ("ask dance", "no request 'dance'; use one of hold, resume"),
    ("ask goto 47.0", "goto where? type 'goto LAT,LON'"),
    ("edit mission.yaml --new 47,8", "leave --new out to edit it"),
    ("fly mission.yaml --control tcp://0.0.0.0:1", "other machines could reach it"),
    ("fly mission.yaml --foxglove web", "web is not [HOST:]PORT"),
    ("convert mission.yaml there.mcap", "a flight's record (.mcap) becomes"),
]
IN_WORLDS = [  # what is changed in the world file, the command, the message
    ("callisto|calisto", "check mission.yaml", "world.yaml:113:5: no ground robot 'calisto'"),
    ("callisto|calisto", "sim mission.yaml", "world.yaml:113:5: no ground robot 'calisto'"),
    ("", "sim mission.yaml --rover mul=ipc:///tmp/mul", "use one of callisto, europa, io"),
]
OF_THE_MACHINE = [
    ("fly mission.yaml --log-dir team.yaml/logs", 5, "Not a directory; name a folder"),
    ("sim mission.yaml --log-dir team.yaml/logs", 5, "Not a directory; name a folder"),
    ("fly mission.yaml --web {taken}", 5, "choose another port, or 0"),
    ("sim {pair} --web {taken}", 5, "choose another port, or 0"),
    ("watch 127.0.0.1:1 --web {taken}", 1, "choose another port, or 0"),
    ("preflight mission.yaml --connect /dev/ttyAMA0", 4, "write udpin://127.0.0.1:14540"),
    ("preflight mission.yaml --connect udp://:14540", 4, "write udpin://127.0.0.1:14540"),
    ("preflight mission.yaml --connect udpin://127.0.0.1:99999", 4, "a number from 1 to 65535"),
    ("preflight mission.yaml --connect udpin://192.0.2.7:14540", 4, "no address 192.0.2.7; udpin"),
    ("preflight mission.yaml --connect udpin://[::1]:14540", 4, "IPv6 is not supported: write"),
    ("preflight mission.yaml --connect serial:///dev/ttyXYZ9:57600", 4, "ttyXYZ9 is not there"),
    ("preflight mission.yaml --connect serial:///etc/passwd:57600", 4, "is no serial device"),
    ("preflight mission.yaml --connect serial:///dev/null:57600", 4, "another program using it?"),
]


@pytest.fixture
def printed(tmp_path, monkeypatch, capsys):
    """Runs a command in a folder with a mission; its exit code, and what it prints."""
    pennovation, data = ROOT / "missions" / "pennovation", ROOT / "tests" / "data"
    shutil.copytree(pennovation, tmp_path, dirs_exist_ok=True)
    shutil.copy(data / "files" / "walk.gpx", tmp_path)
    (tmp_path / "there.kml").write_text("mine")
    rovers = tmp_path / "rovers"
    rovers.mkdir()
    shutil.copy(data / "pennovation.plan", rovers / "town.plan")
    team = (pennovation / "team.yaml").read_text(encoding="utf-8")
    (rovers / "team.yaml").write_text(team.replace("kind: aerial_robot", "kind: ground_robot"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)

    def run(line, program=main):
        try:
            code = program(line.split())
        except SystemExit as end:
            code = end.code
        out, err = capsys.readouterr()
        assert out == ""
        assert "Traceback" not in err
        return code, err

    return run


@pytest.mark.parametrize(
    ("change", "line", "message"), IN_FILES, ids=[row[2][-30:] for row in IN_FILES]
)
def test_mistakes_in_files_end_with_3(printed, tmp_path, change, line, message):
    old, _, new = change.partition("|")
    path = tmp_path / "mission.yaml"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1))
    code, err = printed(line)
    assert (code, message in err) == (3, True), err
    assert len(err.splitlines()) <= 2, err


@pytest.mark.parametrize(("change", "line", "message"), IN_WORLDS, ids=["check", "sim", "rover"])
def test_mistakes_in_what_is_simulated_end_with_3_before_anything_starts(
    printed, tmp_path, change, line, message
):
    old, _, new = change.partition("|")
    path = tmp_path / "world.yaml"
    path.write_text(path.read_text(encoding="utf-8").replace(old, new, 1))
    code, err = printed(line)
    assert (code, message in err) == (3, True), err
    assert len(err.splitlines()) == 1, err


@pytest.mark.parametrize(("line", "message"), IN_USAGE, ids=[row[1][:30] for row in IN_USAGE])
def test_wrong_usage_ends_with_2(printed, tmp_path, line, message):
    code, err = printed(line)
    assert (code, message in err) == (2, True), err
    assert (tmp_path / "there.kml").read_text() == "mine"


@pytest.mark.parametrize(
    ("line", "wanted", "message"), OF_THE_MACHINE, ids=[row[0][-30:] for row in OF_THE_MACHINE]
)
def test_what_the_machine_does_not_have_is_named(printed, line, wanted, message):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        pair = ROOT / "missions" / "pair" / "mission.yaml"
        code, err = printed(line.format(taken=taken.getsockname()[1], pair=pair))
    assert (code, message in err) == (wanted, True), err


def test_a_robot_that_is_not_in_the_team_is_no_node(printed):
    code, err = printed("node team.yaml --robot ugv9", mocha_link.cli.cli.main)
    assert code == 2
    assert "no robot 'ugv9' in team.yaml; use one of callisto, europa, io, titan" in err


def test_a_serial_device_of_others_names_the_group(printed, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    code, err = printed("preflight mission.yaml --connect serial:///dev/null:57600")
    assert code == 4
    assert "no permission for /dev/null): `sudo usermod -aG root $USER`, then log in again" in err
