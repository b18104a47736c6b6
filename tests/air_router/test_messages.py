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

latitudes = st.floats(-90, 90)
longitudes = st.floats(-180, 180)
stamps = st.floats(0, 1e11)


@given(stamps, latitudes, longitudes, st.floats(-360, 720))
def test_a_pose_survives_the_wire(stamp_s, latitude_deg, longitude_deg, heading_deg):
    pose = PoseMessage(
        stamp_s=stamp_s,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        heading_deg=heading_deg,
    )
    assert PoseMessage.decode(pose.encode()) == pose


@given(stamps, st.lists(st.tuples(latitudes, longitudes), max_size=20))
def test_a_path_survives_the_wire(stamp_s, points):
    path = PathMessage(stamp_s=stamp_s, points=tuple(points))
    assert PathMessage.decode(path.encode()) == path


def test_sightings_survive_the_wire():
    seen = SightingsMessage(
        stamp_s=1.0, objects=(SeenObject(kind="vehicle", latitude_deg=1.0, longitude_deg=2.0),)
    )
    assert SightingsMessage.decode(seen.encode()) == seen


@given(st.binary(max_size=200))
def test_random_bytes_are_refused_and_nothing_else_happens(data):
    for kind in (PoseMessage, PathMessage, SightingsMessage):
        with pytest.raises(MessageError):
            kind.decode(data)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"latitude_deg": 91}, "latitude_deg"),
        ({"longitude_deg": "east"}, "longitude_deg"),
        ({"latitude_deg": float("nan")}, "PoseMessage"),
        ({"stamp_s": -1}, "stamp_s"),
    ],
)
def test_impossible_values_are_named(change, said):
    fields = {"stamp_s": 1.0, "latitude_deg": 0.0, "longitude_deg": 0.0, **change}
    with pytest.raises(MessageError, match=said):
        PoseMessage.decode(json.dumps(fields).encode())


def test_a_newer_peer_s_extra_key_does_no_harm():
    data = b'{"stamp_s": 1, "latitude_deg": 2, "longitude_deg": 3, "mood": "good"}'
    assert PoseMessage.decode(data).latitude_deg == 2


def test_a_huge_message_is_refused_before_it_is_parsed():
    with pytest.raises(MessageError, match="too large"):
        PathMessage.decode(b" " * (MESSAGE_LIMIT_BYTES + 1))
