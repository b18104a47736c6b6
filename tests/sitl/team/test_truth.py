"""The truth stream of a vehicle, and the clock that follows it."""

import socket

import pytest
from pymavlink.dialects.v20 import common as mavlink

from sitl.team.truth import SimClock, TruthError, TruthParser, TruthReceiver

WAIT_S = 60.0
UNIX_S = 1_800_000_000.0


def packet(time_s: float, quaternion=(1.0, 0.0, 0.0, 0.0), latitude_deg=40.0) -> bytes:
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    message = packer.hil_state_quaternion_encode(
        int(time_s * 1e6),
        list(quaternion),
        *(0.0, 0.0, 0.0),
        *(int(latitude_deg * 1e7), -750000000, 46700),
        *(0, 0, 0, 0, 0, 0, 0, 0),
    )
    return message.pack(packer)


def test_the_parser_reads_position_time_and_heading():
    state = TruthParser().parse(packet(12.5, (0.7071068, 0.0, 0.0, 0.7071068)))
    assert state is not None
    assert (state.time_s, state.latitude_deg, state.longitude_deg) == (12.5, 40.0, -75.0)
    assert state.altitude_amsl_m == 46.7
    assert state.heading_deg == pytest.approx(90, abs=0.01)


def test_the_parser_survives_whatever_comes():
    parser = TruthParser()
    good = packet(3.0)
    broken = bytes([*good[:-1], good[-1] ^ 0xFF])
    heartbeat = mavlink.MAVLink(None).heartbeat_encode(2, 12, 0, 0, 4).pack(mavlink.MAVLink(None))
    for junk in (b"", b"\xfd", b"junk" * 500, broken, heartbeat, packet(1.0, latitude_deg=200)):
        assert parser.parse(junk) is None
    nan = packet(1.0, (float("nan"), 0.0, 0.0, 0.0))
    assert parser.parse(nan) is None
    for _ in range(2):  # junk before may have eaten the beginning of the first
        state = parser.parse(packet(4.0))
    assert state is not None
    assert state.time_s == 4.0


def test_px4_sends_its_time_in_another_message():
    parser = TruthParser()
    vehicle = mavlink.MAVLink(None)
    time = vehicle.hil_actuator_controls_encode(7_250_000, [0.0] * 16, 0, 0).pack(vehicle)
    assert parser.parse(time) is None
    state = parser.parse(time + packet(0.0))
    assert state is not None
    assert state.time_s == 7.25


def test_the_receiver_takes_the_newest_of_what_waits():
    receiver = TruthReceiver("udp://127.0.0.1:0")
    try:
        host, _, port = receiver.url.removeprefix("udp://").rpartition(":")
        assert receiver.receive(0.0) is None
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            for time_s in (1.0, 2.0, 3.0):
                vehicle.sendto(packet(time_s), (host, int(port)))
        state = receiver.receive(WAIT_S)
        assert state is not None
        assert state.time_s == 3.0
    finally:
        receiver.close()


@pytest.mark.parametrize("url", ["127.0.0.1:19410", "tcp://127.0.0.1:1", "udp://127.0.0.1:x", ""])
def test_a_place_for_the_truth_must_be_a_udp_url(url):
    with pytest.raises(TruthError, match="udp://HOST:PORT"):
        TruthReceiver(url)


def test_the_clock_follows_the_vehicle_and_never_runs_backwards():
    clock = SimClock(UNIX_S)
    assert clock.now_s() == UNIX_S
    clock.advance(10.0)
    clock.advance(9.9)
    assert clock.now_s() == UNIX_S + 10
    clock.advance(0.5)  # the vehicle was started anew
    assert clock.now_s() == UNIX_S + 10
    clock.advance(2.5)
    assert clock.now_s() == UNIX_S + 12
    assert clock.elapsed_s == 12


def test_without_an_epoch_the_clock_starts_at_the_wall_time_of_the_first_packet():
    wall = iter((1000.0, 1060.0))
    clock = SimClock(None, wall_s=lambda: next(wall))
    assert clock.epoch_s is None
    clock.advance(45.0)
    assert clock.epoch_s == 1015.0
    assert clock.now_s() == 1060.0
