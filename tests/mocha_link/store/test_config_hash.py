"""A file of another team file: ids follow from names, so they may mean others now."""

import contextlib
import sqlite3
import time
from pathlib import Path

import pytest

from benchmarks.fleet.network_sim import team_of
from mocha_link.links.metrics import StorageFailed
from mocha_link.node import node
from mocha_link.store.trust import TeamConfig
from tests.mocha_link.conftest import TEAM
from tests.mocha_link.node.test_node_storage import running

EUROPA = "  europa: {kind: ground_robot, address: 127.0.0.1, base_port: 40, clients: [io]}\n"
LARGER = TEAM.replace("  callisto:", EUROPA + "  callisto:").replace(
    "base_port: 30, clients: [callisto, titan]", "base_port: 30, clients: [callisto, titan, europa]"
)


@pytest.fixture
def file(tmp_path) -> Path:
    return tmp_path / "io.db"


def test_a_robot_that_joins_gets_no_other_robot_s_messages(field_of, file, caplog):
    """europa takes io's number."""
    field = field_of(TEAM)
    callisto, _, _ = field.node("callisto")
    callisto.publish("/pose", b"callisto is here")
    with running(field, "io", storage=file) as (io, saw):
        io.publish("/pose", b"io is here")
        saw.pull("callisto")
    later = field_of(LARGER)
    with running(later, "io", storage=file) as (io, _):
        # callisto has kept its number.
        assert [(m.robot, m.data) for m in io.messages()] == [("callisto", b"callisto is here")]
        io.publish("/path", b"way")
    assert "1 message is gone" in caplog.text
    with running(later, "io", storage=file) as (io, _):
        assert {m.data for m in io.messages()} == {b"callisto is here", b"way"}


def test_what_was_refused_before_is_requested_again(field_of, file):
    """titan took nothing from relays, and the knowledge of what callisto has is on disk."""
    field = field_of(TEAM)
    io, _, _ = field.node("io")
    io.publish("/cloud", b"of points")
    _, _, saw = field.node("callisto")
    saw.pull("io")
    own = field.team
    field.team = team_of(own.dump().replace("trust: relays", "trust: signed"))
    with running(field, "titan", storage=file) as (titan, saw):
        saw.pull("callisto")
        assert titan.messages() == []
        assert titan.links()["callisto"].refused
    field.team = own
    with running(field, "titan", storage=file) as (titan, saw):
        saw.pull("callisto")
        assert titan.latest("io", "/cloud").data == b"of points"


def test_a_file_whose_configuration_is_altered(field, file, monkeypatch, caplog):
    """It is reported, though a new file is good before there is a node to report it."""
    with running(field, "titan", storage=file) as (titan, _):
        titan.publish("/map", b"grid")
    with contextlib.closing(sqlite3.connect(file)) as connection:
        connection.execute("UPDATE terms SET mark = x'00', names = '{'")
        connection.commit()
    make = node.Gossip

    def make_slowly(*what, **how):
        made = make(*what, **how)
        while "all is on disk again" not in caplog.text:
            time.sleep(0.001)
        return made

    monkeypatch.setattr(node, "Gossip", make_slowly)
    with running(field, "titan", storage=file) as (titan, saw):
        assert "its configuration is altered" in saw.wait(StorageFailed).reason
        assert titan.messages() == []
        titan.publish("/map", b"grid")
        assert titan.latest("titan", "/map").data == b"grid"


def test_what_counts_as_configuration():
    team = team_of(TEAM)
    assert TeamConfig.of(team).mark == TeamConfig.of(team_of(TEAM + "trust: relays\n")).mark
    assert TeamConfig.of(team).mark != TeamConfig.of(team_of(TEAM + "trust: signed\n")).mark
    assert TeamConfig.of(team).mark != TeamConfig.of(team_of(LARGER)).mark
    moved = team.with_robots({"io": {"base_port": 500, "address": "elsewhere"}})
    assert TeamConfig.of(team).mark == TeamConfig.of(moved).mark
    assert TeamConfig.read(TeamConfig.of(team).text) == TeamConfig.of(team).names
