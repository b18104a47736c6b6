"""`air-router preflight` against vehicles that are, and that are not, what they should be."""

import json
import re
import socket

import pytest
import zmq

from air_router.sim.ports import free_port
from mocha_link import Team
from tests.system.conftest import answer, hurry
from tests.system.simulated import simulated_vehicle

pytestmark = pytest.mark.xdist_group("flights 1")


@pytest.fixture
def preflight(answered, udp_port, short_mission):
    link = f"--connect=udpin://127.0.0.1:{udp_port}"
    return lambda *more: answered("preflight", short_mission, link, *more)


def test_the_card_of_a_vehicle_that_is_ready(vehicle, preflight, tmp_path):
    vehicle()
    code, out, err = preflight("--json", f"--log-dir={tmp_path}")
    assert code == 0, (out, err)
    card = json.loads(out)
    lines = {check["name"]: check for check in card["checks"]}
    assert card["ready"]
    for name in ("vehicle", "state", "place", "GPS", "disk", "plan"):
        assert lines[name]["verdict"] == "ok", lines[name]
    assert lines["health"]["found"] == "ready to arm, with warnings"
    assert lines["health"]["advice"] == "no remote control signal is received"  # none is simulated
    assert lines["vehicle"]["found"] == "quadrotor, PX4 1.18.0, system 1"
    assert "read back, equal, can be flown" in lines["plan"]["found"]
    assert "no node answers now" in lines["team"]["found"]
    assert int(lines["parameters"]["found"].split()[0]) >= 12


def test_a_node_is_distinguished_from_what_takes_any_connection_and_looking_changes_nothing(
    vehicle, preflight, short_mission
):
    vehicle()
    team = Team.load(short_mission.with_name("team.yaml"))
    io, europa = team.robot("io"), team.robot("europa")
    gateway = socket.create_server((europa.address, europa.port_for("titan")))
    with gateway, zmq.Context() as context, context.socket(zmq.REP) as node:
        node.bind(f"tcp://{io.address}:{io.port_for('titan')}")
        code, out, _ = preflight("--look")
    assert code == 0
    text = out.replace("\n", " ")
    assert "callisto, europa: no node answers now" in text
    assert "another one is on board" in text
    assert "\x1b[" not in out


def test_another_place_s_vehicle_is_refused(vehicle, preflight):
    vehicle("--home=47.397742,8.545594,489.4")
    code, out, _ = preflight()
    assert code == 5
    assert "km from the mission's home" in out


@pytest.fixture(scope="module")
def card(shared_folder):
    """The lines of a card, by name; some parameters of the vehicle are wrong."""
    mission, port = hurry(shared_folder / "wrong"), free_port()
    text = re.sub(r"(?m)^accepts: .*$", "", mission.read_text(encoding="utf-8"))
    mission.write_text(text, encoding="utf-8")
    wrong = {"GF_MAX_HOR_DIST": 100, "RTL_RETURN_ALT": 20, "COM_RC_IN_MODE": 4}
    wrong["COM_OBC_LOSS_T"] = 12  # of its seconds, of which ten go in one of ours
    with simulated_vehicle(
        *(mission, "--speed=10", "--no-gcs", f"--api-to=127.0.0.1:{port}", "--px4-version=1.17"),
        f"--truth-to=127.0.0.1:{free_port()}",
        *(f"--param={name}={value}" for name, value in wrong.items()),
    ):
        look = "preflight", mission, "--look", "--json", "--no-record"
        _, out, _ = answer(shared_folder, *look, f"--connect=udpin://127.0.0.1:{port}")
    return {line["name"]: line for line in json.loads(out)["checks"]}


@pytest.mark.parametrize("name", ["GF_MAX_HOR_DIST", "RTL_RETURN_ALT", "COM_RC_IN_MODE", "return"])
def test_what_would_end_a_flight_badly_is_red(card, name):
    assert card[name]["verdict"] == "stop", card


def test_the_wind_is_on_the_card(card):
    assert card["wind"]["verdict"] == "look"


def test_a_time_that_a_fast_simulation_s_parameters_multiply_is_as_wanted(card):
    assert "COM_OBC_LOSS_T" not in card
