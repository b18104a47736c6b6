import socket
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from mocha_link.team.team import Team
from sitl.team.free_ports import NoFreePortsError, derive_team
from sitl.team.nodes import RadioReadings
from sitl.team.relay import relayed_pairs
from sitl.team.truth import TruthError, TruthParser, TruthReceiver
from sitl.world.world import Reading

TEAM = Path(__file__).parents[3] / "missions" / "pennovation" / "team.yaml"
WAIT_S = 60.0


@pytest.fixture
def team():
    return Team.load(TEAM)


def packet(time_s: float, quaternion=(1.0, 0.0, 0.0, 0.0), latitude_deg=40.0) -> bytes:
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    message = packer.hil_state_quaternion_encode(
        int(time_s * 1e6),
        list(quaternion),
        *(0.0, 0.0, 0.0),
        *(int(latitude_deg * 1e7), -750000000, 46700),
        *(0, 0, 0, 0, 0, 0, 0, 0),
    )
    return message.pack(packer)


def test_a_derived_team_has_the_same_ids_and_places_of_its_own(team, tmp_path):
    derived = derive_team(team, tmp_path / "new")
    assert derived.path == tmp_path / "new" / "team.yaml"
    assert Team.load(derived.path).robots == derived.robots
    assert derived.kinds == team.kinds
    places = set()
    for name, robot in team.robots.items():
        other = derived.robot(name)
        assert (other.robot_id, other.clients) == (robot.robot_id, robot.clients)
        assert other.address != other.listen
        places |= {(other.address, other.base_port), (other.listen, other.base_port), other.radio}
    assert len(places) == 12
    assert derive_team(team, tmp_path).robots != derived.robots


def test_every_ordered_pair_of_a_team_is_relayed_where_the_client_dials(team):
    pairs = relayed_pairs(team)
    assert len(pairs) == 12
    pair = next(p for p in pairs if (p.client, p.server) == ("io", "titan"))
    assert pair.dialled == ("127.0.1.4", 24402)
    assert pair.served == ("127.0.0.4", 24402)


def test_when_nothing_is_free_it_says_so(team, tmp_path, monkeypatch):
    monkeypatch.setattr("sitl.team.free_ports._free", lambda *_: False)
    with pytest.raises(NoFreePortsError, match=r"127\.0\.0\.0/8"):
        derive_team(team, tmp_path)


def test_readings_go_to_the_robots_radio(team):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as radio:
        radio.bind(("127.0.0.1", 0))
        radio.settimeout(WAIT_S)
        url = f"udp://127.0.0.1:{radio.getsockname()[1]}"
        changed = team.with_robots({"io": {"radio": url}, "europa": {"radio": None}})
        with RadioReadings(changed) as readings:
            readings.tell([Reading("europa", "io", -70.0), Reading("io", "titan", -61.5)])
            readings.tell([Reading("io", "europa", None)])
        assert radio.recv(1000) == b'{"peer": "titan", "rssi_dbm": -61.5}'
        assert radio.recv(1000) == b'{"peer": "europa", "rssi_dbm": null}'


def test_the_parser_reads_position_time_and_heading():
    state = TruthParser().parse(packet(12.5, (0.7071068, 0.0, 0.0, 0.7071068)))
    assert state is not None
    assert (state.time_s, state.latitude_deg, state.longitude_deg) == (12.5, 40.0, -75.0)
    assert state.altitude_amsl_m == 46.7
    assert state.heading_deg == pytest.approx(90, abs=0.01)


def test_the_parser_survives_whatever_comes():
    parser = TruthParser()
    good = packet(3.0)
    broken = bytes([*good[:-1], good[-1] ^ 0xFF])
    heartbeat = mavlink.MAVLink(None).heartbeat_encode(2, 12, 0, 0, 4).pack(mavlink.MAVLink(None))
    for junk in (b"", b"\xfd", b"junk" * 500, broken, heartbeat, packet(1.0, latitude_deg=200)):
        assert parser.parse(junk) is None
    nan = packet(1.0, (float("nan"), 0.0, 0.0, 0.0))
    assert parser.parse(nan) is None
    for _ in range(2):  # junk before may have eaten the beginning of the first
        state = parser.parse(packet(4.0))
    assert state is not None
    assert state.time_s == 4.0


def test_px4_tells_its_time_in_another_message():
    parser = TruthParser()
    vehicle = mavlink.MAVLink(None)
    time = vehicle.hil_actuator_controls_encode(7_250_000, [0.0] * 16, 0, 0).pack(vehicle)
    assert parser.parse(time) is None
    state = parser.parse(time + packet(0.0))
    assert state is not None
    assert state.time_s == 7.25


def test_the_receiver_takes_the_newest_of_what_waits():
    receiver = TruthReceiver("udp://127.0.0.1:0")
    try:
        host, _, port = receiver.url.removeprefix("udp://").rpartition(":")
        assert receiver.receive(0.0) is None
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            for time_s in (1.0, 2.0, 3.0):
                vehicle.sendto(packet(time_s), (host, int(port)))
        state = receiver.receive(WAIT_S)
        assert state is not None
        assert state.time_s == 3.0
    finally:
        receiver.close()


@pytest.mark.parametrize("url", ["127.0.0.1:19410", "tcp://127.0.0.1:1", "udp://127.0.0.1:x", ""])
def test_a_place_for_the_truth_must_be_a_udp_url(url):
    with pytest.raises(TruthError, match="udp://HOST:PORT"):
        TruthReceiver(url)
