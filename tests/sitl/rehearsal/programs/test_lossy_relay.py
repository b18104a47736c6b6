import json
import os
import signal
import socket
from queue import SimpleQueue

import pytest
from pymavlink.dialects.v20 import common as mavlink

from sitl.px4sim.state import FlightMode
from sitl.rehearsal.fakes.link import StreamFault
from sitl.rehearsal.faults import Fault
from sitl.rehearsal.judge.acceptance import ACCEPTED
from sitl.rehearsal.programs.flight import RealFlight
from sitl.rehearsal.programs.processes import ProcessPause
from sitl.rehearsal.programs.relay import LossyRelay, Weather, wait_until
from sitl.rehearsal.programs.scenes import WIRE, wire_scenes

LIMIT_S = 60.0
POSITION = "GLOBAL_POSITION_INT"


@pytest.fixture
def ends():
    companion, vehicle = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    with companion, vehicle:
        for end in (companion, vehicle):
            end.bind(("127.0.0.1", 0))
            end.settimeout(LIMIT_S)
        yield companion, vehicle


def packed(message, component=1):
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=component)
    return bytes(message(sender).pack(sender))


def heartbeat(*, armed, status=4):
    base_mode = 128 if armed else 0
    return packed(lambda s: s.heartbeat_encode(2, 12, base_mode, 0x04040000, status))


def position(height_m, time_ms=1):
    place = (0, 0, 0, height_m * 1000)
    return packed(lambda s: s.global_position_int_encode(time_ms, *place, 0, 0, 0, 0))


def truth(height_m, time_s):
    place = (399421523, -751997644, round(height_m * 1000))
    return packed(
        lambda s: s.hil_state_quaternion_encode(
            round(time_s * 1e6), [1, 0, 0, 0], 0, 0, 0, *place, *[0] * 8
        )
    )


def test_it_passes_both_ways_and_writes_down_what_passes(ends):
    companion, vehicle = ends
    with LossyRelay(companion.getsockname()[1], 1) as relay:
        vehicle.sendto(truth(6.7, 1.0), ("127.0.0.1", relay.truth_port))
        vehicle.sendto(heartbeat(armed=True, status=5), ("127.0.0.1", relay.api_port))
        received, relayed = companion.recvfrom(4096)
        assert received == heartbeat(armed=True, status=5)
        land = packed(lambda s: s.command_long_encode(1, 1, 21, 0, *[0] * 7), component=191)
        companion.sendto(land, relayed)
        assert vehicle.recvfrom(4096)[0] == land
        relay.station().choose(FlightMode.AUTO_LAND)
        assert vehicle.recvfrom(4096)[0][:1] == b"\xfd"
        vehicle.sendto(truth(26.7, 2.0), ("127.0.0.1", relay.truth_port))
        seen = relay.recording
        assert wait_until(lambda: len(seen.samples) == 2, LIMIT_S)
    last = seen.samples[-1]
    assert (last.altitude_amsl_m, last.armed, last.landed, last.failsafe) == (
        26.7,
        True,
        False,
        True,
    )
    assert [(m.name, m.component) for m in seen.messages] == [
        ("HEARTBEAT", 1),
        ("COMMAND_LONG", 191),
        ("COMMAND_LONG", 190),
    ]
    assert seen.messages[1].fields["command"] == 21


def test_streams_are_lost_frozen_and_late_each_alone(ends):
    companion, vehicle = ends
    with LossyRelay(companion.getsockname()[1], 1) as relay:
        to = ("127.0.0.1", relay.api_port)

        def passed(weather, *frames):
            relay.weather = weather
            for frame in frames:
                vehicle.sendto(frame, to)
            vehicle.sendto(b"".join((position(1), heartbeat(armed=False))), to)
            return [companion.recvfrom(4096)[0] for _ in range(len(frames) + 1)]

        both = position(1) + heartbeat(armed=False)
        assert passed(Weather()) == [both]
        assert passed(Weather(streams={POSITION: StreamFault.LOST})) == [heartbeat(armed=False)]
        frozen = Weather(streams={POSITION: StreamFault.FROZEN})
        assert passed(frozen, position(7)) == [position(7), position(7) + heartbeat(armed=False)]
        late = Weather(streams={POSITION: StreamFault.LATE}, late_s=0.01)
        assert passed(late) == [heartbeat(armed=False)]
        assert companion.recvfrom(4096)[0] == position(1)
        heights_mm = [
            m.fields["relative_alt"] for m in relay.recording.received if m.name != "HEARTBEAT"
        ]
        assert heights_mm == [1000, 7000, 7000, 1000]  # as they reached it
        relay.weather = Weather(silent=True)
        vehicle.sendto(heartbeat(armed=True), to)
        assert wait_until(lambda: relay.recording.armed, LIMIT_S)  # it still listens in
    assert not relay.recording.messages[-1].delivered


def test_the_vehicle_waits_for_a_companion_that_is_behind_what_reached_it(ends):
    companion, vehicle = ends
    held = SimpleQueue()
    with LossyRelay(companion.getsockname()[1], 1, speed=5.0) as relay:
        relay.hold = held.put

        def until(waits):
            while held.get(timeout=LIMIT_S) is not waits:
                pass

        vehicle.sendto(heartbeat(armed=True), ("127.0.0.1", relay.truth_port))
        with socket.create_connection(("127.0.0.1", relay.pace_port)) as report:
            for reached_s, true_s, waits in ((1.0, 1.1, False), (1.0, 1.5, True)):
                report.send(json.dumps({"name": "titan", "reached_s": reached_s}).encode() + b"\n")
                vehicle.sendto(truth(6.7, true_s), ("127.0.0.1", relay.truth_port))
                until(waits)
            report.send(b'{"name": "titan", "reached_s": 1.5}\n')
            until(waits=False)
            vehicle.sendto(position(7, 1500), ("127.0.0.1", relay.api_port))
            companion.recvfrom(4096)
            relay.weather = Weather(loss=1.0)
            vehicle.sendto(truth(6.7, 1.9), ("127.0.0.1", relay.truth_port))
            assert wait_until(lambda: relay.recording.clock_s == 1.9, LIMIT_S)
            while not held.empty():
                held.get()
            assert held.get(timeout=LIMIT_S) is False
    while not held.empty():
        last = held.get()
    assert last is False  # a relay that has ended holds no vehicle


def test_a_station_uploads_a_plan_as_the_vehicle_requests_it(ends):
    companion, vehicle = ends
    item = {"frame": 6, "command": 16, "current": 0, "autocontinue": 0, "x": 5, "y": 6, "z": 20.0}
    item |= {f"param{n}": 0.0 for n in range(1, 5)}
    with LossyRelay(companion.getsockname()[1], 1) as relay:
        vehicle.sendto(heartbeat(armed=True), ("127.0.0.1", relay.api_port))
        companion.recvfrom(4096)
        stored = SimpleQueue()
        relay.upload([item], lambda: stored.put(1))
        vehicle.recvfrom(4096)
        request = packed(lambda s: s.mission_request_int_encode(255, 190, 0, 0))
        vehicle.sendto(request, ("127.0.0.1", relay.api_port))
        sent = mavlink.MAVLink(None).decode(bytearray(vehicle.recvfrom(4096)[0]))
        assert stored.empty()
        done = packed(lambda s: s.mission_ack_encode(255, 190, 0, 0))
        vehicle.sendto(done, ("127.0.0.1", relay.api_port))
        assert stored.get(timeout=LIMIT_S)
    assert (sent.get_type(), sent.x, sent.z) == ("MISSION_ITEM_INT", 5, 20.0)


def test_a_relay_that_comes_late_does_not_stop_a_released_vehicle(monkeypatch):
    class Overtaken(ProcessPause):
        def hold(self, waits):
            super().hold(waits)
            super().hold(waits=True)

    sent = []
    monkeypatch.setattr(os, "killpg", lambda _group, number: sent.append(number))
    brake = Overtaken(group=0)
    brake.hold(waits=True)
    brake.release()
    assert sent == [signal.SIGSTOP, signal.SIGCONT]


def test_every_class_is_flown_in_about_three_hundred_scenes_and_has_its_row():
    scenes = wire_scenes()
    takeovers = [scene.schedule()[-1] for scene in scenes if scene.fault is Fault.PILOT]
    in_a_meeting = {each.value for each in takeovers if each.phase == "COMM"}
    assert in_a_meeting == {"AUTO_RTL", "AUTO_LAND", "POSCTL", "ALTCTL"}
    judged = frozenset().union(*(s.judged for s in scenes))
    assert judged - {s.fault.name for s in scenes} == {"BRIEF_STREAM"}
    assert judged <= set(ACCEPTED)
    assert len(scenes) >= 300
    assert {scene.fault for scene in scenes} == set(WIRE)
    for scene in scenes:
        assert scene.schedule() == scene.schedule()
        for each in scene.schedule():
            assert hasattr(RealFlight, f"do_{each.what.replace(' ', '_')}")
