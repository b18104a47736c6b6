"""What topics can ask for, through whole nodes: aggregation, history, a budget, many and large."""

from __future__ import annotations

import random

import pytest

from mocha_link.links.metrics import Direction, MessageStored, SyncEnded
from mocha_link.store import payload
from tests.mocha_link import original

IN, OUT = Direction.IN, Direction.OUT
PAIR = """\
robots:
  io: {kind: rover, address: 127.0.0.1, base_port: 10, clients: [titan]}
  titan: {kind: rover, address: 127.0.0.1, base_port: 20, clients: [io]}
kinds:
  rover:
    topics:
      - {name: /log, type: json/Log, aggregate: true, min_interval_s: 5}
      - {name: /trail, type: json/Pose, history: 4, priority: high}
      - {name: /map, type: grid/Map}
"""
MANY = (
    PAIR.split("      - {name: /log", maxsplit=1)[0]
    + "".join(f"      - {{name: /t{number}, type: a/B}}\n" for number in range(200))
    + "trigger: {interval_s: 1000}\n"
)


def noise(size: int, seed: int = 1) -> bytes:
    return random.Random(seed).randbytes(size)


# --- several messages in one


def test_messages_that_come_early_cross_as_one(field_of):
    field = field_of(PAIR)
    titan, _, titan_saw = field.node("titan")
    io, _, saw = field.node("io")
    titan.publish("/log", b"0")
    for number in range(1, 6):
        titan.publish("/log", b"%d" % number)
    assert titan.latest("titan", "/log").parts == (b"0",)
    field.clock.time_s += 5
    titan_saw.wait(MessageStored)
    titan_saw.wait(MessageStored)
    io.sync("titan")
    assert saw.wait(SyncEnded, direction=IN).messages == 1
    message = io.latest("titan", "/log")
    assert message.parts == (b"1", b"2", b"3", b"4", b"5")
    assert message.stamp_s < field.clock.now_s() - 4.9  # when the last of them was said


def test_a_message_of_an_original_robot_is_no_batch(field_of):
    """It knows nothing of batches; the others' messages stay readable, and so does its data."""
    field = field_of(PAIR)
    with original.Original(field.team, "titan", now_s=field.clock.now_s) as titan:
        titan.publish("/log", b"plain text")
        titan.publish("/map", b"grid")
        io, _, saw = field.node("io")
        io.sync("titan")
        assert saw.wait(SyncEnded, direction=IN).messages == 2
    assert {message.topic: message.data for message in io.messages()} == {
        "/log": b"plain text",
        "/map": b"grid",
    }
    assert io.latest("titan", "/log").parts == ()
    assert [message.data for message in io.history("titan", "/log")] == [b"plain text"]
    assert {message.topic for _, message in io.stored_since(0)} == {"/log", "/map"}


# --- versions


@pytest.mark.parametrize("datagrams", [True, False])
def test_so_many_versions_are_kept_and_cross(field_of, datagrams):
    field = field_of(PAIR)
    titan, _, _ = field.node("titan", datagrams=datagrams)
    for number in range(6):
        titan.publish("/trail", b"%d" % number)
        titan.publish("/map", b"map %d" % number)
    kept = [b"5", b"4", b"3", b"2"]
    assert [message.data for message in titan.history("titan", "/trail")] == kept
    io, _, saw = field.node("io", datagrams=datagrams)
    io.sync("titan")
    assert saw.wait(SyncEnded, direction=IN).messages == 5
    assert [message.data for message in io.history("titan", "/trail")] == kept
    assert [message.data for message in io.history("titan", "/map")] == [b"map 5"]
    assert io.latest("titan", "/trail").data == b"5"
    titan.publish("/trail", b"6")
    io.sync("titan")
    assert saw.wait(SyncEnded, direction=IN).messages == 1
    assert [message.data for message in io.history("titan", "/trail")] == [b"6", *kept[:3]]


def test_an_original_robot_is_offered_the_newest_version_only(field_of):
    field = field_of(PAIR)
    titan, _, saw = field.node("titan")
    for number in range(6):
        titan.publish("/trail", b"%d" % number)
    with original.Original(field.team, "io", now_s=field.clock.now_s) as io:
        pull = io.pull("titan")
        assert len(pull.offered) == len(pull.stored) == 1
        assert io.data("titan", "/trail") == b"5"
        saw.wait(SyncEnded, direction=OUT)


def test_what_another_program_has_missed(field_of):
    """Everything that is kept and was stored after a number, in order."""
    field = field_of(PAIR)
    titan, _, _ = field.node("titan")
    for number in range(3):
        titan.publish("/trail", b"%d" % number)
    stored = titan.stored_since(0)
    assert [message.data for _, message in stored] == [b"0", b"1", b"2"]
    titan.publish("/map", b"grid")
    titan.publish("/map", b"grid 2")
    assert [m.data for _, m in titan.stored_since(stored[-1][0])] == [b"grid 2"]
    assert titan.stored_since(0, 2) == stored[:2]
    assert titan.epoch


# --- a budget


def test_a_contact_costs_no_more_than_its_budget(field_of):
    field = field_of(PAIR + "trigger: {interval_s: 1, budget_bytes: 30000}\n")
    titan, _, _ = field.node("titan")
    titan.publish("/map", noise(60_000))
    titan.publish("/trail", b"small")
    io, radio, saw = field.node("io")
    radio.report("titan", -50)
    ended = saw.wait(SyncEnded, direction=IN)
    assert not ended.complete
    assert io.latest("titan", "/trail").data == b"small"
    assert io.links()["titan"].bytes_in < 31_500
    assert not io.sync("titan")  # nothing is left of it
    for _ in range(3):  # the next contacts bring the rest
        radio.report("titan", None)
        radio.report("titan", -50)
        if saw.wait(SyncEnded, direction=IN).complete:
            break
    assert io.latest("titan", "/map").data == noise(60_000)
    assert io.links()["titan"].bytes_in < 70_000


# --- many and large


@pytest.mark.parametrize("way", ["new", "original"])
def test_many_large_messages_over_one_connection(field_of, way):
    """More under way at once than a connection holds: nothing of it may be dropped."""
    field = field_of(MANY)
    if way == "original":  # the peer is new, but the team file says that it is not
        field.team = field.team.with_robots({"titan": {"original": True}})
    titan, _, _ = field.node("titan")
    for number in range(200):
        titan.publish(f"/t{number}", noise(100_000, number))
    io, _, saw = field.node("io", timeout_s=60)
    for _ in range(2):
        io.sync("titan")
        saw.wait(SyncEnded, direction=IN)
        for number in range(200):
            assert io.latest("titan", f"/t{number}").data == noise(100_000, number)
            titan.publish(f"/t{number}", noise(100_000, number))
    assert io.links()["titan"].timeouts == 0
    assert io.links()["titan"].refused == 0


def test_the_largest_message_that_there_is(field_of, monkeypatch):
    """Incompressible, so that what crosses is larger than the data."""
    monkeypatch.setattr(payload, "MAX_BYTES", 8 * 1024 * 1024)
    field = field_of(PAIR)
    titan, _, _ = field.node("titan")
    largest = noise(8 * 1024 * 1024)
    titan.publish("/map", largest)
    io, _, saw = field.node("io")
    io.sync("titan")
    assert saw.wait(SyncEnded, direction=IN).messages == 1
    assert io.latest("titan", "/map").data == largest
