import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.messages import (
    MESSAGE_LIMIT_BYTES,
    MessageError,
    PathMessage,
    PoseMessage,
    SeenObject,
    SightingsMessage,
)

stamps = st.floats(0, 1e11)
places = st.tuples(st.floats(-90, 90), st.floats(-180, 180))


@given(stamps, places, st.floats(-360, 720), st.lists(places, max_size=20))
def test_messages_survive_the_wire(stamp_s, place, heading_deg, points):
    at = {"latitude_deg": place[0], "longitude_deg": place[1]}
    seen = SeenObject(kind="vehicle", **at)
    for message in (
        PoseMessage(stamp_s=stamp_s, heading_deg=heading_deg, **at),
        PathMessage(stamp_s=stamp_s, points=tuple(points)),
        SightingsMessage(stamp_s=stamp_s, objects=(seen,)),
    ):
        assert type(message).decode(message.encode()) == message


@given(st.binary(max_size=200))
def test_random_bytes_are_refused_and_nothing_else_happens(data):
    for kind in (PoseMessage, PathMessage, SightingsMessage):
        with pytest.raises(MessageError):
            kind.decode(data)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"latitude_deg": 91}, "latitude_deg"),
        ({"longitude_deg": "east"}, "longitude_deg"),
        ({"latitude_deg": float("nan")}, "PoseMessage"),
        ({"stamp_s": -1}, "stamp_s"),
    ],
)
def test_impossible_values_are_named(change, message):
    fields = {"stamp_s": 1.0, "latitude_deg": 0.0, "longitude_deg": 0.0, **change}
    with pytest.raises(MessageError, match=message):
        PoseMessage.decode(json.dumps(fields).encode())


def test_a_newer_peer_s_extra_key_does_no_harm():
    data = b'{"stamp_s": 1, "latitude_deg": 2, "longitude_deg": 3, "mood": "good"}'
    assert PoseMessage.decode(data).latitude_deg == 2


def test_a_huge_message_is_refused_before_it_is_parsed():
    with pytest.raises(MessageError, match="too large"):
        PathMessage.decode(b" " * (MESSAGE_LIMIT_BYTES + 1))
