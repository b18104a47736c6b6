"""A mission in three dimensions: how high its fence and zones are drawn."""

import dataclasses
import math

import pytest
from mcap.records import Schema

pytest.importorskip("foxglove", reason="the extra `foxglove` is not installed")
pytest.importorskip("mcap_protobuf")

from mcap_protobuf.decoder import DecoderFactory

from air_router.record.drawing import FlightDrawing
from geo.airspace.zone import Band, Circle, Zone
from geo.frame import Point

ABOVE_M = 20.0  # what is drawn of a zone above the highest place that is flown to


@pytest.fixture
def mission(pennovation):
    """One waypoint is higher than the others, by more than a zone without limits is drawn above."""
    highest = dataclasses.replace(pennovation.waypoints[3], altitude_above_home_m=75.0)
    waypoints = (*pennovation.waypoints[:3], highest, *pennovation.waypoints[4:])
    return dataclasses.replace(pennovation, waypoints=waypoints)


def entities(mission):
    """What is drawn of a mission in three dimensions, as a public reader decodes it."""
    factory = DecoderFactory()
    for channel, message in FlightDrawing(mission).begin(0.0):
        if channel.topic == "/scene":
            schema = Schema(1, channel.schema, "protobuf", channel.schema_name)
            return factory.decoder_for("protobuf", schema)(message).entities
    raise AssertionError("no scene is drawn")


def heights(mission, band):
    """From where to where the walls of a zone with this band are drawn, and its name's height."""
    zone = Zone("box", Circle(Point(0.0, 0.0), 5.0), band=band)
    with_zone = dataclasses.replace(mission, zones=(zone,))
    (drawn,) = (each for each in entities(with_zone) if each.id == "zone box")
    walls_m = [corner.z for corner in drawn.triangles[0].points]
    name_m = drawn.texts[0].pose.position.z
    return min(walls_m), max(walls_m), name_m


@pytest.mark.parametrize(
    ("band", "low_m", "high_m"),
    [
        (None, 0.0, 75.0 + ABOVE_M),
        (Band(10.0, 80.0), 10.0, 80.0),
        (Band(-30.0, 40.0), 0.0, 40.0),
        (Band(10.0, math.inf), 10.0, 75.0 + ABOVE_M),
        (Band(500.0, 600.0), 75.0 + ABOVE_M, 75.0 + ABOVE_M),  # a lid
    ],
)
def test_a_zone_is_drawn_from_the_ground_to_somewhat_above_what_is_flown(
    mission, band, low_m, high_m
):
    assert heights(mission, band) == (low_m, high_m, high_m)


def test_the_fence_is_drawn_as_high_as_the_highest_waypoint(mission):
    fence = entities(mission)[0]
    assert {corner.z for corner in fence.triangles[0].points} == {0.0, 75.0}
