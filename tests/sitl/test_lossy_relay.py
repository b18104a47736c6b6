import socket

import pytest
from pymavlink.dialects.v20 import common as mavlink

from sitl.rehearsal.lossy_relay import LossyRelay, wait_until
from sitl.rehearsal.over_mavlink import FLIGHTS, scenes_over_mavlink

LIMIT_S = 60.0


@pytest.fixture
def ends():
    companion, vehicle = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    with companion, vehicle:
        for end in (companion, vehicle):
            end.bind(("127.0.0.1", 0))
            end.settimeout(LIMIT_S)
        yield companion, vehicle


def heartbeat(*, armed, status):
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    base_mode = 128 if armed else 0
    return bytes(sender.heartbeat_encode(2, 12, base_mode, 0x04040000, status).pack(sender))


def test_it_passes_both_ways_and_listens_in(ends):
    companion, vehicle = ends
    with LossyRelay(companion.getsockname()[1], 0.0, 1) as relay:
        vehicle.sendto(heartbeat(armed=True, status=5), ("127.0.0.1", relay.api_port))
        said, relayed = companion.recvfrom(4096)
        companion.sendto(b"answer", relayed)
        assert vehicle.recvfrom(4096)[0] == b"answer"
        relay.inject(b"a pilot")
        assert vehicle.recvfrom(4096)[0] == b"a pilot"
        assert said[:1] == b"\xfd"
        assert (relay.mode, relay.armed, relay.failsafe) == (0x04040000, True, True)


def test_the_truth_is_for_the_judge(ends):
    companion, vehicle = ends
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    truth = sender.hil_state_quaternion_encode(
        1, [1, 0, 0, 0], 0, 0, 0, 399421523, -751997644, 46700, *[0] * 8
    )
    with LossyRelay(companion.getsockname()[1], 0.0, 1) as relay:
        vehicle.sendto(bytes(truth.pack(sender)), ("127.0.0.1", relay.truth_port))
        assert wait_until(lambda: relay.truth is not None, LIMIT_S)
        assert relay.truth == pytest.approx((39.9421523, -75.1997644, 46.7))


def test_what_is_lost_is_lost(ends):
    companion, _ = ends
    relay = LossyRelay(companion.getsockname()[1], 0.2, 1)
    with relay:
        passed = sum(relay._passes() for _ in range(2000))
        assert 1500 < passed < 1700
        relay.silent = True
        assert not relay._passes()


def test_forty_flights_and_more():
    assert len(scenes_over_mavlink()) == sum(FLIGHTS.values()) >= 40
