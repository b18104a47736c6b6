"""Every event and action there is becomes JSON and comes back the same."""

import copy
import dataclasses
import itertools
import json
import math
import typing
from datetime import time
from enum import Enum
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st

from air_router.controller.model.actions import CommandAck, FlyToNode, StateChanged
from air_router.controller.model.events import AirspaceChanged, CommandFailed
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.states import Signal, State
from air_router.mission.loading import load_mission
from air_router.record import values
from air_router.record.serialization import decode, encode, members, schema_of
from air_router.record.values import CodecError, decoder, recorded_name
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Band, Circle, Outline, Shape, Zone
from geo.frame import Point
from geo.validity import Hours, Period, Validity
from mocha_link.links.metrics import MessageStored
from mocha_link.links.reading import Reading, Unit
from mocha_link.store.wire import Header

NUMBERS = st.floats(-1e6, 1e6)
RING = st.just((Point(0.0, 0.0), Point(10.1, 0.0), Point(3.3, 7.7)))
SPECIAL = {  # classes that refuse most of what their fields' types allow
    Header: st.builds(Header, *(st.integers(0, most) for most in (255, 255, 65535, 999))),
    Reading: st.builds(Reading, st.floats(-99, 9), st.sampled_from(Unit), st.sampled_from("ab")),
    Shape: st.one_of(
        st.builds(Outline, RING),
        st.builds(Circle, st.builds(Point, NUMBERS, NUMBERS), st.just(3.7)),
    ),
    Zone: st.builds(
        Zone, st.text(), st.builds(Outline, RING), clearance_m=st.floats(0, 9), band=st.none()
    ),
}


def strategy(hint):  # noqa: PLR0911
    """Values of a declared type; numbers and texts of every kind, seldom a long tuple."""
    if hint in SPECIAL:
        return SPECIAL[hint]
    if hint is float:
        return st.floats() | st.integers(-99, 99)
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return st.deferred(lambda: built(hint))
    if isinstance(hint, type) and hasattr(hint, "_fields"):
        hints = typing.get_type_hints(hint)
        return st.builds(hint, **{name: strategy(hints[name]) for name in hint._fields})
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is tuple:
        if arguments[-1] is Ellipsis:
            return st.lists(strategy(arguments[0]), max_size=3).map(tuple)
        return st.tuples(*map(strategy, arguments))
    if (arguments and type(None) in arguments) or isinstance(hint, type(int | str)):
        return st.one_of(*map(strategy, arguments))
    return st.from_type(hint)


@st.composite
def built(draw, kind):
    hints = typing.get_type_hints(kind)
    fields = [field.name for field in dataclasses.fields(kind) if field.init]
    drawn = {name: draw(strategy(hints[name])) for name in fields}
    try:
        return kind(**drawn)
    except Exception:  # noqa: BLE001 - a class may refuse what it likes
        reject()


def same(one, other):
    """Equal in every bit: NaN is NaN, -0.0 is not 0.0, and 1 is not True."""
    if isinstance(one, float) and isinstance(other, float):
        return repr(one) == repr(other)
    if type(one) is not type(other):
        return False
    if dataclasses.is_dataclass(one):
        names = [field.name for field in dataclasses.fields(one) if field.init]
        return all(same(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other


def assert_viewers_understand(schema):
    """The part of JSON schema that Foxglove and Lichtblick read; anything else hides a channel."""
    assert schema["type"] in {"boolean", "string", "number", "integer", "object", "array"}
    assert not {"oneOf", "anyOf", "$ref", "prefixItems"} & schema.keys()
    assert schema.get("contentEncoding", "base64") == "base64"
    if schema["type"] == "array":
        assert schema["items"]["type"] != "array"
        assert "contentEncoding" not in schema["items"]
        assert_viewers_understand(schema["items"])
    for part in schema["properties"].values() if schema["type"] == "object" else ():
        assert_viewers_understand(part)


def test_records_call_a_class_as_before():
    plain = encode(CommandAck("1", "kim", accepted=True, why="it stops"))
    assert plain["type"] == "Answered"
    assert isinstance(decode(plain), CommandAck)


def test_records_call_a_field_as_before(pennovation):
    plain = values.encode(FlightSetup(pennovation, pilot_arms=True))
    assert plain["patient"] is True
    mission = plain["mission"]
    assert {"columns", "column_airspace"} < mission.keys()
    assert "ease_m" in mission["airspace"]
    now = {"pilot_arms", "climb_corridors", "climb_airspace", "relaxed_m"}
    assert not now & (plain.keys() | mission.keys() | mission["airspace"].keys())
    again = decoder(FlightSetup)(plain)
    assert again.pilot_arms
    assert again.mission.climb_airspace.zones == pennovation.climb_airspace.zones
    assert again.mission.airspace.relaxed_m == pennovation.airspace.relaxed_m


@pytest.mark.parametrize("kind", members().values(), ids=lambda kind: kind.__name__)
@settings(max_examples=8, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_every_event_and_action_comes_back(kind, data):
    value = data.draw(st.sampled_from(kind) if issubclass(kind, Enum) else strategy(kind))
    text = json.dumps(encode(value), allow_nan=False)
    assert same(decode(json.loads(text)), value)
    schema = schema_of(kind)
    assert_viewers_understand(schema)
    assert schema["title"] == recorded_name(kind)
    assert encode(value).keys() == schema["properties"].keys()


MISSIONS = sorted((Path(__file__).parents[3] / "missions").rglob("mission.yaml"))


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.parent.name)
def test_a_whole_mission_comes_back(path):
    """What a controller is made of; its airspaces too, which are no dataclasses."""
    uavs = [layer.uav for layer in load_mission(path).layers]
    mission = load_mission(path, uav=uavs[-1] if len(uavs) > 1 else None)
    hours = Validity((Period(daily=(Hours(frozenset({0, 3}), time(8), time(9, 30)),)),))
    timed = Zone("t", Circle(Point(0.1, 0.2), 3.3), band=Band(-math.inf, 50.0), validity=hours)
    mission = mission.with_areas(mission.fences, (*mission.zones, timed))
    plain = values.encode(mission)
    again = decoder(type(mission))(json.loads(json.dumps(plain, allow_nan=False)))
    assert values.encode(again) == plain
    for field in dataclasses.fields(mission):
        here, there = getattr(mission, field.name), getattr(again, field.name)
        assert type(here) is type(there)
        if not isinstance(here, Airspace):
            assert here == there, field.name
        else:
            assert (here.zones, here.distances_m) == (there.zones, there.distances_m)


def test_what_an_object_looks_like():
    failed = CommandFailed(FlyToNode(3, Point(math.nan, -math.inf)), "no")
    assert encode(failed) == {
        "type": "CommandFailed",
        "action": {
            "type": "FlyToNode",
            "node": 3,
            "position": {"east_m": "NaN", "north_m": "-Infinity"},
        },
        "reason": "no",
        "sent": True,
        "taken": None,
    }


STORED = encode(MessageStored("io", 1.0, "io", "/pose", Header(1, 0, 5, 6), 99))


def test_what_an_older_record_did_not_know_has_its_default_or_is_nothing_where_it_may_be():
    lacking = {"type": "Telemetry", "time_s": 1, "position": {"east_m": 1, "north_m": 2}}
    assert decode({**lacking, "altitude_m": 3.5}) == Telemetry(1, Point(1, 2), 3.5)
    changed = encode(StateChanged(State.INIT, Signal.TIMER, State.SEARCH, "io"))
    del changed["robot"]  # has no default
    assert decode(changed) == StateChanged(State.INIT, Signal.TIMER, State.SEARCH, None)
    assert decode({"type": "AirspaceChanged", "fences": []}) == AirspaceChanged((), ())
    with pytest.raises(CodecError, match="StateChanged without signal"):
        decode({key: value for key, value in changed.items() if key != "signal"})


GOOD = encode(
    Telemetry(1.0, Point(1.0, 2.0), 3.0, mode=FlightMode.HOLD, target=Point(5.0, 6.0), battery=0.5)
)
BAD = [None, 7, True, "x", [], [1], {}, {"type": "Telemetry"}, {"type": ["Telemetry"]}, "Infinity "]


def test_a_wrong_field_is_one_kind_of_error():
    for key, bad in itertools.product(GOOD, BAD):
        wrong = {**copy.deepcopy(GOOD), key: bad}
        try:
            value = decode(wrong)
        except CodecError:
            continue
        assert encode(value) == wrong, (key, bad)  # some of them are good in some places


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (None, "not an object"),
        ({"type": "Nothing"}, "'Nothing' is no event or action"),
        ({**GOOD, "speed": 1}, "Telemetry has no 'speed'"),
        ({"type": "Telemetry", "time_s": 1.0}, "Telemetry without altitude_m, position"),
        ({**GOOD, "position": [1.0, 2.0]}, "Telemetry.position: "),
        (
            {**STORED, "header": {**STORED["header"], "robot_id": 999}},
            "MessageStored.header: no Header: 999",
        ),
    ],
)
def test_what_is_wrong_is_told(wrong, message):
    with pytest.raises(CodecError) as told:
        decode(wrong)
    assert message in str(told.value)


@pytest.mark.parametrize("value", ["text", Point(1, 2), Telemetry])
def test_what_is_no_event_is_refused(value):
    with pytest.raises(TypeError, match="neither an event nor an action"):
        encode(value)


@pytest.mark.parametrize(
    ("hint", "value"),
    [
        (frozenset[str], frozenset({"b", "a"})),
        (dict[str, float], {"a": math.inf}),
        (tuple[int, str] | None, (1, "x")),
        (list[Point], [Point(1.5, 2.5)]),
        (float | str | None, "NaN "),
        (typing.Literal["one", "two"], "two"),
    ],
)
def test_other_types_that_a_field_may_have(hint, value):
    assert decoder(hint)(json.loads(json.dumps(values.encode(value)))) == value
    with pytest.raises(CodecError):
        decoder(hint)({"type": "Telemetry"})
