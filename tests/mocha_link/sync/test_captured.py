"""The recorded sync of original nodes: read byte for byte, answered and requested as they did."""

import json
from typing import NamedTuple

import pytest

from mocha_link.clock import Instant
from mocha_link.links.metrics import Direction, MessageStored, SyncEnded, SyncStarted
from mocha_link.store import wire
from mocha_link.store.database import Database
from mocha_link.store.record import Record
from mocha_link.store.wire import Header
from mocha_link.sync import original
from mocha_link.sync.original import ClientSession, ServerSession
from mocha_link.team.team import Team
from tests.mocha_link.conftest import DATA
from tests.mocha_link.network import peer_of

NOW = Instant(1795175905.0, 100.0)  # shortly after the recording


def exchange(*connections: int) -> list[tuple[bytes, bytes]]:
    """The recorded requests and replies of some connections."""
    frames = [
        bytes.fromhex(frame["hex"])
        for frame in json.loads((DATA / "exchange.json").read_text())
        if frame["conn"] in connections
    ]
    return list(zip(frames[::2], frames[1::2], strict=True))


class Pull(NamedTuple):
    """One recorded pull: who pulled from whom, and what each of them held before."""

    connections: range
    server: str
    client: str
    server_holds: tuple[str, ...]
    client_holds: tuple[str, ...]


BOTH = ("callisto", "titan")
PULLS = [
    Pull(range(1, 5), "titan", "callisto", ("titan",), ("callisto",)),
    Pull(range(5, 9), "callisto", "titan", BOTH, ("titan",)),
    Pull(range(9, 11), "titan", "callisto", BOTH, BOTH),
]


@pytest.fixture(scope="module")
def recorded_team() -> Team:
    return Team.load(DATA / "team.yaml")


@pytest.fixture(scope="module")
def bodies() -> dict[bytes, bytes]:
    """Header to body of every recorded message."""
    return {
        request[11:]: reply[6:]
        for request, reply in exchange(*range(1, 9))
        if request[6:11] == b"GDATA"
    }


def database(team: Team, bodies: dict[bytes, bytes], *robots: str) -> Database:
    """A database with the recorded messages of some robots."""
    result = Database()
    for raw, body in bodies.items():
        header = Header.parse(raw)
        robot, topic = team.by_ids(header.robot_id, header.topic_id)
        if robot.name in robots:
            stamp_ms = header.stamp_ms(NOW.unix_s)
            result.insert(
                Record(header, topic.priority, body, stamp_ms, stamp_ms / 1000), NOW.unix_s
            )
    return result


def test_headers_and_bodies_are_what_was_published(recorded_team, bodies):
    decoded = {}
    for raw, body in bodies.items():
        header = Header.parse(raw)
        assert header.pack() == raw
        robot, topic = recorded_team.by_ids(header.robot_id, header.topic_id)
        assert body[0] == topic.dtype
        assert body[1] == topic.priority
        decoded[robot.name, topic.name] = (header.stamp_s(NOW.unix_s), wire.unpack(body))
    assert {name: len(data) for name, (_, data) in decoded.items()} == {
        ("titan", "/asoom/path_viz"): 172,
        ("titan", "/asoom/recent_key_pose"): 74,
        ("callisto", "/top_down_render/pose_est"): 362,
        ("callisto", "/spomp_global/path_viz"): 172,
    }
    stamp_s, path = decoded["titan", "/asoom/path_viz"]
    # ROS 1: header.seq, header.stamp (the message's own, 3 ms before), frame "m0", 2 poses
    assert path[:22] == bytes.fromhex("01000000db35006b62e93229020000006d3002000000")
    assert int.from_bytes(path[4:8], "little") == int(stamp_s) == 1795175899


def test_we_pack_the_same_bytes(bodies):
    for body in bodies.values():
        ours = wire.pack(body[0], body[1], wire.unpack(body), stamp_ms=0)
        assert ours.startswith(body)  # our trailer follows


@pytest.mark.parametrize("pull", PULLS)
def test_our_server_answers_as_the_real_node(recorded_team, bodies, pull):
    held = database(recorded_team, bodies, *pull.server_holds)
    peer = peer_of(held, name=pull.client)
    session = ServerSession(peer)
    for request, reply in exchange(*pull.connections):
        assert session.handle([request], NOW) == reply
    messages = len(exchange(*pull.connections)) - 2
    size = sum(len(reply) for _, reply in exchange(*pull.connections))
    assert peer.log.events == [
        SyncStarted(pull.client, NOW.unix_s, Direction.OUT),
        SyncEnded(pull.client, NOW.unix_s, Direction.OUT, messages, size, 0.0),
    ]


@pytest.mark.parametrize("pull", PULLS)
@pytest.mark.parametrize("window", [1, 8])
def test_our_client_requests_what_the_real_one_requested(
    recorded_team, bodies, pull, window, monkeypatch
):
    monkeypatch.setattr(original, "MIN_WINDOW", window)
    monkeypatch.setattr(original, "MAX_WINDOW", window)
    recorded = exchange(*pull.connections)
    ids = iter(request[:6] for request, _ in recorded)
    own = database(recorded_team, bodies, *pull.client_holds)
    peer = peer_of(
        own, name=pull.server, team=recorded_team, own=pull.client, new_id=lambda: next(ids)
    )
    session = ClientSession(peer)
    replies = dict(recorded)
    requested, pending = [], [session.start(NOW)]
    while pending:
        requested.append(pending.pop(0))
        pending += session.reply([replies[requested[-1]]], NOW)
    assert not peer.log.refusals
    assert requested == [request for request, _ in recorded]
    assert session.over
    assert session.failure is None
    stored = [event for event in peer.log.events if isinstance(event, MessageStored)]
    assert session.messages == len(stored) == len(recorded) - 2
    assert [event.header.pack() for event in stored] == [r[11:] for r in requested[1:-1]]
    for event in stored:
        record = own.newest(event.header.robot_id, event.header.topic_id)
        assert record.body == bodies[event.header.pack()]
