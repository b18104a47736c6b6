"""The check of what is simulated around a mission, by the program that reads it."""

import shutil
import signal
import sys

import pytest

from air_router.preflight.world_check import WorldRefusedError, check_world
from mocha_link.team import DocumentError
from tests.docs.blocks import ROOT


@pytest.fixture
def mission(tmp_path):
    shutil.copytree(ROOT / "missions" / "pennovation", tmp_path / "site")
    return tmp_path / "site" / "mission.yaml"


def test_of_a_good_world_nothing_is_printed(mission, capsys):
    check_world(mission, [("europa", "tcp://127.0.0.1:24999")])
    assert capsys.readouterr() == ("", "")


def test_every_mistake_of_the_world_file_has_its_place(mission, capsys):
    world = mission.with_name("world.yaml")
    world.write_text(world.read_text() + "weather: rain\n")
    with pytest.raises(DocumentError) as caught:
        check_world(mission)
    (problem,) = caught.value.problems
    assert problem.path.name == "world.yaml"
    assert problem.line == len(world.read_text().splitlines())
    assert "weather" in problem.message
    assert capsys.readouterr() == ("", "")


def test_a_program_plays_no_robot_that_is_not_there(mission):
    with pytest.raises(WorldRefusedError, match=r"no robot of .* is called 'ganymede'"):
        check_world(mission, [("ganymede", "tcp://127.0.0.1:24999")])


def test_what_the_caller_has_set_up_is_as_before(mission, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["air-router", "check"])
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        check_world(mission)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert sys.argv == ["air-router", "check"]
