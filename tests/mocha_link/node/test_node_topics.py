"""What topics can request, through whole nodes: aggregation, history, a budget, many and large."""

import pytest

from mocha_link.links.metrics import Direction
from tests.mocha_link import original
from tests.mocha_link.conftest import DATA, noise

IN, OUT = Direction.IN, Direction.OUT
PAIR = (DATA / "pair.yaml").read_text()
MANY = (
    PAIR.partition("      - {name: /log")[0]
    + "".join(f"      - {{name: /t{number}, type: a/B}}\n" for number in range(100))
    + "trigger: {interval_s: 1000}\n"
)


def test_a_message_of_an_original_robot_is_no_batch(field_of):
    """It knows nothing of batches; the others' messages stay readable, and so does its data."""
    field = field_of(PAIR)
    with original.Original(field.team, "titan", now_s=field.clock.now_s) as titan:
        titan.publish("/log", b"plain text")
        titan.publish("/map", b"grid")
        io, _, saw = field.node("io")
        assert saw.pull("titan").messages == 2
    assert {message.topic: message.data for message in io.messages()} == {
        "/log": b"plain text",
        "/map": b"grid",
    }
    assert io.latest("titan", "/log").parts == ()
    assert [message.data for message in io.history("titan", "/log")] == [b"plain text"]
    assert {message.topic for _, message in io.stored_since(0)} == {"/log", "/map"}


@pytest.mark.parametrize("way", ["new", "original"])
def test_many_large_messages_over_one_connection(field_of, way):
    """More under way at once than a connection holds: nothing of it may be dropped."""
    field = field_of(MANY)
    if way == "original":  # the peer is new, but original in the team file
        field.team = field.team.with_robots({"titan": {"original": True}})
    titan, _, _ = field.node("titan")
    for number in range(100):
        titan.publish(f"/t{number}", noise(100_000, number))
    io, _, saw = field.node("io", timeout_s=60)
    for _ in range(2):
        saw.pull("titan")
        for number in range(100):
            assert io.latest("titan", f"/t{number}").data == noise(100_000, number)
            titan.publish(f"/t{number}", noise(100_000, number))
    assert io.links()["titan"].timeouts == 0
    assert io.links()["titan"].refused == 0
