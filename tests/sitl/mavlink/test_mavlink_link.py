"""What goes over the wire beside missions: answers, silences, streams, texts, parameters."""

import math
import struct

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from sitl.mavlink.mavlink_codec import DEFINITIONS, Receiver, Sender
from sitl.px4sim.state.notice import Notice, Outgoing, Severity
from sitl.px4sim.state.parameters import Parameters, UnknownParameterError

ACCEPTED, DENIED = 0, 2


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

    def test_a_recorded_frame_is_packed_byte_for_byte(self):
        recorded = bytes.fromhex("fd0a0000aa01012a000000000600030111b5ebc2ff5d")
        sender = Sender(1)
        sender._sequence = 0xAA
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

    def test_the_dialect_has_what_is_streamed(self, rig):
        rig.run(5)
        names = rig.vehicle._telemetry._builders
        assert all(name in DEFINITIONS for name in names)
        (one,) = struct.unpack("<f", struct.pack("<i", 1))  # of a whole number the bits are sent
        rig.vehicle.autopilot.parameters.set("EKF2_DRAG_CTRL", one, 6)  # it estimates the wind
        rig.fly()  # on the ground there is nothing to fly to
        assert all(rig.vehicle._telemetry.message(name) is not None for name in names)


def heartbeat():
    names = ("type", "autopilot", "base_mode", "custom_mode", "system_status", "mavlink_version")
    return dict.fromkeys(names, 0)


class TestCommands:
    def test_home_and_reboot(self, rig):
        rig.run(5)
        assert rig.command(179, 1) == [ACCEPTED]
        latitude, longitude = rig.degrees(30, 0)
        assert rig.command(179, 0, 0, 0, 0, latitude, longitude, 480) == [ACCEPTED]
        assert rig.autopilot.situation.home == pytest.approx((30, 0), abs=1)
        assert rig.command(179, 0) == [DENIED]
        assert rig.command(246, 0) == [ACCEPTED]

    def test_an_answer_names_who_asked(self, rig):
        rig.run(5)
        rig.command(512, 148, source=(245, 190))
        ack = rig.onboard.last("COMMAND_ACK")
        assert (ack.command, ack.target_system, ack.target_component) == (512, 245, 190)


class TestStreams:
    def rate(self, rig, number, seconds=10, link="onboard"):
        getattr(rig, link).FAST = frozenset()
        ear = getattr(rig, link)
        ear.clear()
        rig.run(seconds)
        name = mavlink.mavlink_map[number].msgname
        return len(ear.all(name)) / seconds

    def test_an_interval_is_set_and_taken_back(self, rig):
        rig.run(5)
        assert rig.command(511, 33, 200000) == [ACCEPTED]
        assert self.rate(rig, 33) == pytest.approx(5, abs=0.11)
        assert self.rate(rig, 33, link="ground") == pytest.approx(25, abs=0.2)  # every step
        assert rig.command(511, 33, -1) == [ACCEPTED]
        assert self.rate(rig, 33) == 0
        assert rig.command(510, 33) == [ACCEPTED]
        assert rig.onboard.last("MESSAGE_INTERVAL").interval_us == -1
        assert rig.command(511, 33, 0) == [ACCEPTED]
        assert self.rate(rig, 33) == pytest.approx(10, abs=0.2)

    def test_a_message_comes_before_its_acknowledgement(self, rig):
        rig.run(5)
        assert rig.command(512, 148) == [ACCEPTED]
        names = rig.onboard.names()
        assert names.index("AUTOPILOT_VERSION") < names.index("COMMAND_ACK")
        version = rig.onboard.last("AUTOPILOT_VERSION")
        assert version.flight_sw_version == 0x011100FF


class TestTexts:
    def test_events_are_numbered(self, rig):
        rig.ready()
        rig.command(400, 1)
        rig.run(8)  # the reports of its health come within seconds
        total = rig.onboard.last("CURRENT_EVENT_SEQUENCE").sequence
        assert total == rig.vehicle._telemetry.status.events_sent - 1 > 10

    def test_the_health_report_is_the_recorded_one(self, rig):
        rig.run(10)
        summaries = [
            event.arguments[:17].hex()
            for event in rig.onboard.all("EVENT")
            if Notice(Severity.INFO, event="commander_arming_check_summary").event_id == event.id
        ]
        assert summaries[0].startswith("000000130180000000")  # attitude, positions, no sticks
        assert summaries[-1] == "000000100080000000b03a7f80b03a7f80"  # what it can be armed in

    def test_a_command_to_the_vehicle_is_not_passed_on(self, rig):
        rig.run(5)
        rig.vehicle.ground.take_frames()
        sender = mavlink.MAVLink(None, 1, 191)
        command = sender.command_long_encode(1, 1, 512, 0, 148, *(math.nan,) * 6).pack(sender)
        rig.vehicle.receive(rig.vehicle.onboard, command)
        assert rig.vehicle.ground.take_frames() == []


class TestParameters:
    def values(self, rig, name, *fields):
        rig.onboard.clear()
        rig.send(name, *fields)
        rig.run(0.1)
        return [(value.param_id, value.param_value) for value in rig.onboard.all("PARAM_VALUE")]

    def test_read_by_name_and_by_index(self, rig):
        rig.run(3)
        assert self.values(rig, "param_request_read", 1, 1, b"NAV_ACC_RAD", -1) == [
            ("NAV_ACC_RAD", 2.0)
        ]
        (index,) = {value.param_index for value in rig.onboard.all("PARAM_VALUE")}
        assert self.values(rig, "param_request_read", 1, 1, b"", index) == [("NAV_ACC_RAD", 2.0)]

    def test_the_hash_tells_a_ground_station_that_it_has_them_all(self, rig):
        rig.run(3)
        before = self.values(rig, "param_request_read", 1, 1, b"_HASH_CHECK", -1)
        assert len(before) == 1
        (wire,) = struct.unpack("<f", struct.pack("<i", 3))
        self.values(rig, "param_set", 1, 1, b"GF_ACTION", wire, 6)
        assert self.values(rig, "param_request_read", 1, 1, b"_HASH_CHECK", -1) != before
        rig.onboard.clear()
        rig.send("param_request_list", 1, 1)
        rig.run(0.1)
        rig.send("param_set", 1, 1, b"_HASH_CHECK", 0.0, 5)
        rig.run(2)
        assert len(rig.onboard.all("PARAM_VALUE")) < 200  # it stops

    def test_a_changed_speed_is_flown(self, rig):
        rig.fly()
        self.values(rig, "param_set", 1, 1, b"MPC_XY_CRUISE", 3.0, 9)
        rig.reposition(60, 0, math.nan)
        rig.run(5)
        assert rig.autopilot.situation.velocity_m_s[0] == pytest.approx(2.7, abs=0.35)

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
    if len(names) != len(fields) or set(definition.fields) - set(values):
        return packed
    return sender.pack(Outgoing(message.msgname, values))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    datagrams=st.lists(st.one_of(st.binary(max_size=300), random_frames()), max_size=30),
    flying=st.booleans(),
)
def test_nothing_that_comes_in_ever_raises(flown, datagrams, flying):
    rig = flown(flying)
    for datagram in datagrams:
        for link in (rig.vehicle.onboard, rig.vehicle.ground):
            rig.vehicle.receive(link, datagram)
        rig.run(0.1)
    rig.run(3)
    assert all(math.isfinite(value) for value in rig.position())


@pytest.fixture
def flown(make_rig):
    def make(flying):
        rig = make_rig()
        rig.ready()
        if flying:
            rig.autopilot.arm()
            rig.autopilot.take_off(500.0)
            rig.command(22)
            rig.run(8)
        return rig

    return make


def test_since_when_it_flies_is_told_when_it_is_asked_for(rig):
    rig.run(5)
    assert rig.command(512, 264) == [ACCEPTED]
    assert rig.onboard.last("FLIGHT_INFORMATION").takeoff_time_utc == 0
