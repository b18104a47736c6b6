import socket
from pathlib import Path

import pytest

from mocha_link.team.team import Team
from sitl.team.derived_team import NoFreePortsError, derive_team
from sitl.team.nodes import RadioReadings
from sitl.team.relay import relayed_pairs
from sitl.world.world import Reading

TEAM = Path(__file__).parents[3] / "missions" / "pennovation" / "team.yaml"
WAIT_S = 60.0


@pytest.fixture
def team():
    return Team.load(TEAM)


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


def test_when_nothing_is_free_it_is_reported(team, tmp_path, monkeypatch):
    monkeypatch.setattr("sitl.team.derived_team.is_free", lambda *_: False)
    with pytest.raises(NoFreePortsError, match=r"127\.0\.0\.0/8"):
        derive_team(team, tmp_path)


def test_readings_go_to_the_robots_radio(team):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as radio:
        radio.bind(("127.0.0.1", 0))
        radio.settimeout(WAIT_S)
        url = f"udp://127.0.0.1:{radio.getsockname()[1]}"
        changed = team.with_robots({"io": {"radio": url}, "europa": {"radio": None}})
        with RadioReadings(changed) as readings:
            readings.send_readings([Reading("europa", "io", -70.0), Reading("io", "titan", -61.5)])
            readings.send_readings([Reading("io", "europa", None)])
        assert radio.recv(1000) == b'{"peer": "titan", "rssi_dbm": -61.5}'
        assert radio.recv(1000) == b'{"peer": "europa", "rssi_dbm": null}'
