"""Every event and action there is becomes JSON and comes back the same."""

import copy
import dataclasses
import itertools
import json
import math
import typing
from collections.abc import Mapping
from datetime import time
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import jsonschema
import numpy as np
import pytest
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st

from air_router.controller.flight_status import AirspaceStatus, FlightStatus, TargetStatus
from air_router.controller.model.actions import (
    Action,
    Announce,
    ControlHolder,
    Finish,
    FlyToNode,
    FlyToPoint,
    MissionWaits,
    Motion,
    Refusal,
)
from air_router.controller.model.airspace_in_force import ZoneChange
from air_router.controller.model.authority import PlanOwner
from air_router.controller.model.events import CommandConfirmed, CommandFailed, Event
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.requests import GoTo
from air_router.controller.model.standing_alarms import StandingAlarm
from air_router.controller.model.states import Signal, State
from air_router.controller.model.task import Goal
from air_router.mission.loading import load_mission
from air_router.record.channels import viewer_schema
from air_router.record.serialization import (
    CodecError,
    adapter,
    decode,
    encode,
    json_of,
    json_schema,
    plain_of,
    read,
)
from air_router.routing import Leg
from air_router.vehicle.instructions import TAKE_OVER_NOW
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Band, Circle, Outline, Shape, Zone
from geo.frame import Point
from geo.validity import Hours, Period, Validity
from mocha_link.links.metrics import LinkMetrics, MessageStored
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
        return st.floats()
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


PUBLISHED = {
    decided: jsonschema.Draft202012Validator(json_schema("x", union))
    for decided, union in ((False, Event), (True, Action))
}
"""Validators of the schemas that we publish: for events, and for actions."""

MEMBERS = (*typing.get_args(Event), *typing.get_args(Action))


@pytest.mark.parametrize("kind", MEMBERS, ids=lambda kind: kind.__name__)
@settings(max_examples=8, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_every_event_and_action_comes_back(kind, data):
    value = data.draw(strategy(kind))
    text = encode(value)
    assert same(decode(json.loads(text, parse_constant=pytest.fail)), value)
    plain, schema = plain_of(value), viewer_schema(kind)
    PUBLISHED[kind in typing.get_args(Action)].validate(plain)
    assert plain["type"] == kind.__name__
    assert_viewers_understand(schema)
    assert schema["title"] == kind.__name__
    assert plain.keys() == schema["properties"].keys()


def test_no_two_events_or_actions_have_one_name():
    assert len({kind.__name__ for kind in MEMBERS}) == len(MEMBERS)


@pytest.mark.parametrize("motion", typing.get_args(Motion), ids=lambda kind: kind.__name__)
@settings(max_examples=8, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_a_motion_within_an_event_comes_back_as_the_one_that_it_is(motion, data):
    event = CommandFailed(data.draw(strategy(motion)), "no", taken=FlightMode.POSITION)
    assert same(decode(plain_of(event)), event)
    assert plain_of(event)["action"]["type"] == motion.__name__


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, -0.0, 1e-320, 0.1 + 0.2])
def test_every_number_comes_back_in_every_bit(number):
    for value in (FlyToPoint(Point(number, 1.0), number), GoTo((Point(0.0, number),), number)):
        assert same(decode(json.loads(encode(value))), value)


@pytest.mark.parametrize("member", [*FlightMode, *State, *Signal, *ControlHolder, *Refusal])
def test_a_member_of_an_enum_is_written_by_its_name(member):
    """Values of some are sentences, which are worded anew."""
    kind = type(member)
    text = adapter(kind).dump_json(member)
    assert json.loads(text) == member.name
    assert read(kind, json.loads(text)) is member


def test_numbers_of_numpy_and_whole_numbers_are_written_as_what_is_declared():
    odd = FlyToNode(np.int64(3), Point(np.float32(1.5), 2))
    assert encode(odd) == encode(FlyToNode(3, Point(1.5, 2.0)))
    assert encode(Finish(np.bool_(1), "x")) == encode(Finish(landed_by_us=True, why="x"))


def test_a_name_that_is_no_utf_8_is_written_with_what_is_text_in_it(pennovation):
    """As Linux allows names of files, and Python has them."""
    assert decode(json.loads(encode(Announce("m\udcff.yaml")))) == Announce("m?.yaml")
    odd = dataclasses.replace(pennovation, path=Path("m\udcff.yaml"))
    assert decode(json.loads(encode(FlightSetup(odd)))).mission.path == Path("m?.yaml")
    note = json_of({"path": Path("m\udcff.yaml"), "name": "\udcff", "age_s": math.nan})
    assert json.loads(note.encode()) == {"path": "m?.yaml", "name": "?", "age_s": None}


MISSIONS = sorted((Path(__file__).parents[3] / "missions").rglob("mission.yaml"))


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.parent.name)
def test_a_whole_mission_comes_back(path):
    """What a controller is made of; its airspaces too, which are no dataclasses."""
    uavs = [layer.uav for layer in load_mission(path).layers]
    mission = load_mission(path, uav=uavs[-1] if len(uavs) > 1 else None)
    hours = Validity((Period(daily=(Hours(frozenset({0, 3}), time(8), time(9, 30)),)),))
    timed = Zone("t", Circle(Point(0.1, 0.2), 3.3), band=Band(-math.inf, 50.0), validity=hours)
    mission = mission.with_areas(mission.fences, (*mission.zones, timed))
    setup = FlightSetup(mission, seek=("io",), pilot_arms=True)
    again = decode(json.loads(encode(setup)))
    assert encode(again) == encode(setup)
    for field in dataclasses.fields(mission):
        here, there = getattr(mission, field.name), getattr(again.mission, field.name)
        assert type(here) is type(there)
        if not isinstance(here, Airspace):
            assert here == there, field.name
        else:
            assert (here.zones, here.distances_m) == (there.zones, there.distances_m)


def test_what_an_object_looks_like():
    failed = CommandFailed(FlyToNode(3, Point(math.nan, -math.inf)), "no")
    assert plain_of(failed) == {
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


STORED = plain_of(MessageStored("io", 1.0, "io", "/pose", Header(1, 0, 5, 6), 99))


def test_a_field_that_is_missing_has_its_default_or_is_reported():
    lacking = {"type": "Telemetry", "time_s": 1, "position": {"east_m": 1, "north_m": 2}}
    assert decode({**lacking, "altitude_m": 3.5}) == Telemetry(1, Point(1, 2), 3.5)
    with pytest.raises(CodecError, match=r"Telemetry\.altitude_m: .*Field required"):
        decode(lacking)


GOOD = plain_of(
    Telemetry(1.0, Point(1.0, 2.0), 3.0, mode=FlightMode.HOLD, target=Point(5.0, 6.0), battery=0.5)
)
BAD = [None, 7, True, "x", [], [1], {}, {"type": "Telemetry"}, {"type": ["Telemetry"]}, "Infinit"]


def test_a_wrong_field_is_one_kind_of_error():
    for key, bad in itertools.product(GOOD, BAD):
        wrong = {**copy.deepcopy(GOOD), key: bad}
        try:
            value = decode(wrong)
        except CodecError:
            continue
        want = {**wrong, "ages": plain_of(Telemetry(1.0, Point(0, 0), 0))["ages"]}
        assert plain_of(value) == want, (key, bad)  # some of them are good in some places


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (None, "None: its type is not allowed here"),
        ({"type": "Nothing"}, "{'type': 'Nothing'}: its type is not allowed here"),
        ({**GOOD, "speed": 1}, "Telemetry.speed: 1: Extra inputs are not permitted"),
        ({**GOOD, "position": [1.0, 2.0]}, "Telemetry.position: [1.0, 2.0]: "),
        ({**GOOD, "mode": "Hold"}, "Telemetry.mode: 'Hold': Input should be 'MISSION', 'HOLD'"),
        (
            {**STORED, "header": {**STORED["header"], "robot_id": 999}},
            "MessageStored.header: {'robot_id': 999",
        ),
    ],
)
def test_what_is_wrong_is_reported(wrong, message):
    with pytest.raises(CodecError) as caught:
        decode(wrong)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "value",
    [
        "text",
        Point(1, 2),
        Telemetry,
        Telemetry(1.0, (1.0, 2.0), 3.0),
        Telemetry("soon", Point(1.0, 2.0), 3.0),
        Finish(landed_by_us=1, why="x"),
        CommandConfirmed("nothing"),
        FlyToNode(3.5, Point(1.0, 2.0)),
    ],
)
def test_what_is_no_event_or_not_as_its_class_declares_is_refused(value):
    with pytest.raises(TypeError, match="cannot be recorded"):
        encode(value)


@pytest.mark.parametrize(
    ("hint", "value"),
    [
        (frozenset[str], frozenset({"b", "a"})),
        (Mapping[str, float], {"a": math.inf}),
        (tuple[int, str] | None, (1, "x")),
        (tuple[Point, ...], (Point(1.5, 2.5),)),
        (Literal["one", "two"], "two"),
        (Point, Point(1.5, math.inf)),
    ],
)
def test_other_types_that_a_field_may_have(hint, value):
    assert read(hint, json.loads(adapter(hint).dump_json(value))) == value
    with pytest.raises(CodecError):
        read(hint, {"type": "Telemetry"})


def test_the_whole_status_comes_back():
    """The picture of a flight that pages and programs get; it is published as records are."""
    waiting = MissionWaits("INPUT_MISSING", "no GPS fix", 2.5)
    alarm = StandingAlarm("the link is silent", TAKE_OVER_NOW, 1.0, math.inf)
    targets = {"io": TargetStatus(Point(1.0, 2.0), 3.5), "callisto": TargetStatus()}
    status = FlightStatus(
        time_s=4.0,
        state=State.SEARCH,
        robot="io",
        targets=MappingProxyType(targets),
        left_s=None,
        goal=Goal(Point(3.0, 4.0), 2),
        legs=(Leg(Point(3.0, 4.0), 2),),
        points_left=0,
        waypoints_left=3,
        no_way_home=False,
        interlocks=("INPUT_MISSING", "ZONE_UPDATE"),
        waiting=waiting,
        refusals={"seek": "GPS has no fix"},
        alarms={"link": alarm},
        need_home=0.25,
        in_charge=True,
        plan_owner=PlanOwner.REPLACED,
        airspace=AirspaceStatus(2, 5, ZoneChange.UPLOADING),
        silent_s=0.0,
        missing_inputs=("GPS has no fix",),
        telemetry=Telemetry(1.0, Point(1.0, math.nan), 3.0),
        links={"io": LinkMetrics("io", signal=Reading(-60.0, Unit.DBM, "radio"))},
    )
    plain = json.loads(adapter(FlightStatus).dump_json(status))
    jsonschema.validate(plain, json_schema("Flight status", FlightStatus))
    again = read(FlightStatus, plain)
    assert same(dataclasses.replace(again, targets=None), dataclasses.replace(status, targets=None))
    assert again.targets == status.targets
    assert again.waiting_s == 1.5
