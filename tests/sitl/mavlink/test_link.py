"""What goes over the wire beyond the conversations: answers, silences, streams, two links."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from sitl.conformance.conversation import Start, run_steps
from sitl.conformance.expecting import event_id
from sitl.conformance.session import LinkKind, Session
from sitl.mavlink import telemetry
from sitl.mavlink.codec import DEFINITIONS, Outgoing, Receiver, Sender, frames
from sitl.px4sim.failsafe import Cause
from sitl.px4sim.parameters import Parameters, UnknownParameterError
from sitl.px4sim.state import EVENTS, Notice, Severity
from sitl.px4sim.versions import BEHAVIOURS, USUAL
from tests.sitl.prepared import local_line, ready_for

ROOT = Path(__file__).parents[3]
ROOMS = ("px4sim", "mavlink")


class TestCodec:
    def test_a_packed_message_is_read_by_pymavlink(self):
        fields = {
            "time_boot_ms": 48940,
            "lat": 473981053,
            "lon": 85460568,
            "alt": 512919,
            "relative_alt": 23646,
            "vx": 18,
            "vy": 299,
            "vz": -50,
            "hdg": 9004,
        }
        sender, receiver = Sender(3), Receiver()
        sender.pack(Outgoing("GLOBAL_POSITION_INT", fields))
        (message,) = receiver.parse(sender.pack(Outgoing("GLOBAL_POSITION_INT", fields)))
        assert {name: getattr(message, name) for name in fields} == fields
        assert (message.get_srcSystem(), message.get_srcComponent(), message.get_seq()) == (3, 1, 1)

    def test_a_frame_of_an_unknown_message_is_not_intact(self):
        packed = Sender(3).pack(Outgoing("HEARTBEAT", heartbeat()))
        (known,) = frames(packed)
        (unknown,) = frames(packed[:7] + b"\xff\xff\xff" + packed[10:])
        assert (known.name, known.intact) == ("HEARTBEAT", True)
        assert (unknown.name, unknown.intact) == ("", False)

    def test_a_recorded_frame_is_packed_byte_for_byte(self):
        recorded = bytes.fromhex("fd0a0000aa01012a000000000600030111b5ebc2ff5d")
        sender = Sender(1)
        for _ in range(0xAA):
            sender.pack(Outgoing("HEARTBEAT", heartbeat()))
        fields = {
            "seq": 0,
            "total": 6,
            "mission_state": 3,
            "mission_mode": 1,
            "mission_id": 3270227217,
            "fence_id": 0,
            "rally_points_id": 0,
        }
        assert sender.pack(Outgoing("MISSION_CURRENT", fields)) == recorded

    def test_broken_frames_do_not_swallow_the_next_datagram(self):
        frame = Sender(1).pack(Outgoing("HEARTBEAT", heartbeat()))
        receiver = Receiver()
        assert receiver.parse(b"\xfd\xff\x00" + frame) == []
        assert len(receiver.parse(frame)) == 1
        assert receiver.parse(frame[:-1] + b"\x00") == []
        assert len(receiver.parse(b"noise" + frame)) == 1

    @pytest.mark.parametrize(
        ("name", "number"),
        [
            ("commander_armed_by", 26266355),
            ("mission_execute", 32375217),
            ("commander_rtl", 20262116),
            ("rtl_land_at_destination", 16962474),
        ],
    )
    def test_event_ids_are_px4s(self, name, number):
        assert Notice(Severity.INFO, event=name).event_id == number

    def test_every_event_that_is_sent_has_its_text_and_no_other(self):
        files = [file for room in ROOMS for file in (ROOT / "sitl" / room).glob("*.py")]
        strings = re.findall(r'"([a-z]+_\w+)"', "\n".join(f.read_text("utf-8") for f in files))
        batteries = {f"check_{cause.name.lower()}" for cause in Cause if "BATTERY" in cause.name}
        fields = {field for of in DEFINITIONS.values() for field in of.defaults}
        roots = tuple({event.partition("_")[0] for event in EVENTS})
        others = {event for each in BEHAVIOURS.values() for event, _ in each.texts.values()}
        named = {name for name in strings if name.startswith(roots)} - fields - others
        assert named | batteries <= EVENTS.keys() <= {*strings} | batteries

    def test_the_dialect_has_what_is_streamed(self):
        autopilot = ready_for(Start.AIR, {"EKF2_DRAG_CTRL": 1}).line.vehicle.autopilot
        names = [name for name in DEFINITIONS if telemetry.knows(name)]
        assert len(names) > 15
        # On the ground there is nothing to fly to, and no wind is estimated.
        assert all(telemetry.message(name, autopilot) is not None for name in names)


@pytest.mark.parametrize(("kind", "vtol"), [(2, 0), (1, 0), (22, 3)])
def test_its_type_is_that_of_mav_type_as_of_a_px4(kind, vtol):
    autopilot = ready_for(Start.GROUND, {"MAV_TYPE": kind}).line.vehicle.autopilot
    assert telemetry.message("HEARTBEAT", autopilot).fields["type"] == kind
    assert telemetry.message("EXTENDED_SYS_STATE", autopilot).fields["vtol_state"] == vtol


def heartbeat():
    names = ("type", "autopilot", "base_mode", "custom_mode", "system_status", "mavlink_version")
    return dict.fromkeys(names, 0)


def test_a_message_comes_before_its_acknowledgement():
    session = ready_for()
    session.send("COMMAND_LONG", command="REQUEST_MESSAGE", param1=148)
    names = [message.name for message in session.line.vehicle.onboard.take_queue()]
    assert names == ["AUTOPILOT_VERSION", "COMMAND_ACK"]


def test_events_are_numbered():
    session = ready_for()
    run_steps(session, [{"command": "COMPONENT_ARM_DISARM", "params": (1,)}, {"wait": 8.0}])
    total = session.newest("CURRENT_EVENT_SEQUENCE")["sequence"]
    assert total == session.line.vehicle.autopilot.events_sent - 1 > 10


def test_the_health_report_is_the_recorded_one():
    session = Session(local_line(), USUAL)
    session.run(10)
    summaries = [
        bytes(event.fields["arguments"])[:17].hex()
        for event in session.since("EVENT")
        if event.fields["id"] == event_id("commander_arming_check_summary")
    ]
    assert summaries[0].startswith("000000130180000000")  # attitude, positions, no sticks
    assert summaries[-1] == "000000100080000000b03a7f80b03a7f80"  # what it can be armed in


def test_a_command_to_the_vehicle_is_not_passed_on():
    session = ready_for(links=frozenset(LinkKind))
    session.send("COMMAND_LONG", command="REQUEST_MESSAGE", param1=148)
    assert session.line.vehicle.ground.take_frames() == []


def test_two_links_cannot_upload_at_once():
    session = ready_for(links=frozenset(LinkKind))
    session.send("MISSION_COUNT", count=2)
    session.send("MISSION_COUNT", LinkKind.GROUND, count=2)
    assert session.run(1.0, lambda: bool(session.since("MISSION_ACK", link=LinkKind.GROUND)))
    assert session.newest("MISSION_ACK", LinkKind.GROUND)["type"] == 1  # MAV_MISSION_ERROR


def test_time_outs_are_on_the_wall_clock_when_the_simulation_is_fast():
    session = Session(local_line(speed=10.0), USUAL)
    session.run(5)
    requested = {"count": "MISSION_REQUEST_INT", "fields": {"seq": 0}}
    upload = {"send": "MISSION_COUNT", "fields": {"count": 3}}
    run_steps(session, [upload, requested | {"for_s": 20, "between": (8, 9)}])  # two wall seconds


class TestParameters:
    def values(self, session, name, **fields):
        session.mark()
        session.send(name, **fields)
        session.run(0.1)
        return [value.fields for value in session.since("PARAM_VALUE")]

    def test_read_by_name_and_by_index(self):
        session = ready_for()
        by = {"param_id": "NAV_ACC_RAD", "param_index": -1}
        (by_name,) = self.values(session, "PARAM_REQUEST_READ", **by)
        assert (by_name["param_id"], by_name["param_value"]) == ("NAV_ACC_RAD", 10.0)
        index = by_name["param_index"]
        assert self.values(session, "PARAM_REQUEST_READ", param_index=index) == [by_name]

    def test_only_known_ones_can_be_given_at_the_start(self):
        with pytest.raises(UnknownParameterError, match="NO_SUCH"):
            Parameters({"NO_SUCH": 1})


anything = st.one_of(st.floats(width=32), st.sampled_from([0.0, 1.0, 4.0, -1.0]))
MESSAGES = sorted(
    number
    for number, message in mavlink.mavlink_map.items()
    if message.msgname.startswith(
        ("MISSION", "COMMAND", "PARAM", "SET_MODE", "HEARTBEAT", "SET_POSITION", "MANUAL_CONTROL")
    )
)


COMMANDS = [16, 20, 21, 22, 31, 93, 176, 177, 178, 179, 192, 300, 400, 511, 512, 5002]


@st.composite
def random_frames(draw):
    """Well-formed frames of messages that the vehicle listens to, with random fields."""
    message = mavlink.mavlink_map[draw(st.sampled_from(MESSAGES))]
    payload = bytearray(
        draw(st.binary(min_size=message.unpacker.size, max_size=message.unpacker.size))
    )
    fields = list(message.unpacker.unpack(bytes(payload)))
    for index, name in enumerate(message.ordered_fieldnames):
        if name in ("target_system", "target_component"):
            fields[index] = 1
        elif name in ("seq", "count") and draw(st.booleans()):
            fields[index] = draw(st.integers(0, 3))
        elif name in ("mission_type", "frame") and draw(st.booleans()):
            fields[index] = draw(st.sampled_from([0, 1, 2, 6]))
        elif name == "command":
            fields[index] = draw(st.sampled_from(COMMANDS))
        elif isinstance(fields[index], float):
            fields[index] = draw(anything)
    sender = Sender(draw(st.sampled_from([1, 255])), draw(st.sampled_from([190, 191])))
    names = message.ordered_fieldnames
    packed = message.unpacker.pack(*fields)
    definition = DEFINITIONS[message.msgname]
    values = dict(zip(names, fields, strict=False))
    if len(names) != len(fields) or set(definition.defaults) - set(values):
        return packed
    return sender.pack(Outgoing(message.msgname, values))


@given(
    datagrams=st.lists(st.one_of(st.binary(max_size=300), random_frames()), max_size=30),
    start=st.sampled_from((Start.GROUND, Start.AIR)),
)
def test_nothing_that_comes_in_ever_raises(datagrams, start):
    session = ready_for(start, links=frozenset(LinkKind))
    vehicle = session.line.vehicle
    for datagram in datagrams:
        for link in (vehicle.onboard, vehicle.ground):
            vehicle.receive(link, datagram)
        session.run(0.1)
    session.run(1)
    airframe = vehicle.autopilot.airframe
    assert all(map(math.isfinite, (airframe.north_m, airframe.east_m, airframe.up_m)))
