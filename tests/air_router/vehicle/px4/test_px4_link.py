"""The UDP end of the vehicle's link: who is listened to, and who is answered."""

import contextlib
import queue
import socket

import pytest
from pymavlink.dialects.v20 import common as mavlink

from air_router.vehicle.px4.limits import PEER_PORT_ANEW_S, SOCKET_BUFFER_S
from air_router.vehicle.px4.mavlink_signing import MavlinkSigner
from air_router.vehicle.px4.px4_link import RECEIVE_BYTES, PeerFilter, Px4Link, frames, widen
from air_router.vehicle.px4.signing_key import SigningKey

VEHICLE, INTRUDER = ("10.0.0.5", 14580), ("10.0.0.66", 14580)


def heartbeat(system=1, component=1, version=2):
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    message = mavlink.MAVLink_heartbeat_message(2, 12, 128, 0, 4, 3)
    return message.pack(link, force_mavlink1=version == 1)


def position(boot_ms):
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    message = mavlink.MAVLink_global_position_int_message(boot_ms, 0, 0, 0, 0, 0, 0, 0, 0)
    return message.pack(link)


@pytest.mark.parametrize("version", [1, 2])
def test_frames_of_a_datagram(version):
    datagram = heartbeat(7, 3, version) + position(5) + heartbeat(1, 1, version)
    assert list(frames(datagram)) == [(7, 3, 0), (1, 1, 33), (1, 1, 0)]
    assert list(frames(datagram[:-1])) == [(7, 3, 0), (1, 1, 33)]
    assert list(frames(b"POST / HTTP/1.1\r\n")) == []


def test_the_vehicle_is_learned_by_its_heartbeat_and_others_are_refused(caplog):
    found = PeerFilter(system_id=1)
    assert found.takes(heartbeat(255, 190), INTRUDER, 0.0)  # what is there, for the operator
    assert found.takes(position(5), INTRUDER, 0.0)
    assert found.peer is None
    assert found.takes(heartbeat(), VEHICLE, 1.0)
    assert found.peer == VEHICLE
    for datagram in (heartbeat(), position(5), b""):
        assert not found.takes(datagram, INTRUDER, 1.1)
    assert found.takes(position(6), VEHICLE, 1.2)
    assert (found.peer, found.refused) == (VEHICLE, 3)
    assert caplog.text.count("its messages are ignored") == 1


def test_a_vehicle_that_was_silent_may_come_back_on_another_port_of_its_host():
    found = PeerFilter(system_id=1)
    found.takes(heartbeat(), VEHICLE, 0.0)
    again, later_s = (VEHICLE[0], 20000), PEER_PORT_ANEW_S + 1.0
    assert not found.takes(heartbeat(), again, PEER_PORT_ANEW_S - 1.0)
    assert not found.takes(position(5), again, later_s)
    assert not found.takes(heartbeat(), INTRUDER, later_s)
    assert found.takes(heartbeat(), again, later_s)
    assert found.peer == again


def test_over_real_sockets():
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.bind(("127.0.0.1", 0))
    here = bound.getsockname()
    received = queue.Queue()
    vehicle, intruder = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    link = Px4Link(bound, 1, received.put)
    with vehicle, intruder:
        link.send(b"too early")
        vehicle.sendto(heartbeat(), here)
        assert received.get(timeout=20) == heartbeat()
        intruder.sendto(position(5), here)
        vehicle.sendto(position(6), here)
        assert received.get(timeout=20) == position(6)
        link.send(b"an order")
        vehicle.settimeout(20)
        assert vehicle.recv(100) == b"an order"
        link.close()
    assert received.empty()


KEY = SigningKey(bytes(range(1, 33)))


@contextlib.contextmanager
def signed_link():
    """A link with a key, what it hands on, and where it listens."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.bind(("127.0.0.1", 0))
    received = queue.Queue()
    link = Px4Link(bound, 1, received.put, MavlinkSigner(KEY, 1))
    try:
        yield link, received, bound.getsockname()
    finally:
        link.close()


@pytest.fixture
def senders():
    """Two UDP ports of other machines."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
    ):
        for each in (first, second):
            each.bind(("127.0.0.1", 0))
            each.settimeout(20)
        yield first, second


def test_on_a_signed_link_the_vehicle_is_known_by_its_signature(senders):
    intruder, vehicle = senders
    its = MavlinkSigner(KEY, 1)
    with signed_link() as (link, received, here):
        intruder.sendto(heartbeat(), here)
        intruder.sendto(MavlinkSigner(SigningKey(b"x" * 32), 1).sign(heartbeat()), here)
        vehicle.sendto(its.sign(heartbeat()), here)
        assert received.get(timeout=20) == heartbeat()
        vehicle.sendto(position(5) + its.sign(position(6)), here)
        assert received.get(timeout=20) == position(6)
        link.send(heartbeat(9))
        assert its.received(vehicle.recv(300)) == heartbeat(9)
        assert received.empty()
        intruder.setblocking(False)
        with pytest.raises(BlockingIOError):
            intruder.recv(300)


def test_a_vehicle_that_has_restarted_is_sent_our_heartbeats_until_it_goes_by_our_time(senders):
    _, vehicle = senders
    its = MavlinkSigner(KEY, 1, unix_s=lambda: 1_500_000_000)  # since it got its key
    with signed_link() as (link, received, here):
        while True:  # as MAVSDK does, once a second
            vehicle.sendto(its.sign(heartbeat()), here)
            link.send(position(1))  # nothing but heartbeats
            link.send(heartbeat(9))
            vehicle.settimeout(0.05)
            try:
                frame = vehicle.recv(300)
            except TimeoutError:
                continue
            break
        assert received.empty()
        assert its.received(frame) == heartbeat(9)
        vehicle.sendto(its.sign(heartbeat()), here)
        assert received.get(timeout=20) == heartbeat()


def test_a_vehicle_that_signs_is_noticed_on_a_link_without_a_key():
    found = PeerFilter(system_id=1)
    assert found.takes(heartbeat(), VEHICLE, 0.0)
    assert not found.signs
    found = PeerFilter(system_id=1)
    assert found.takes(MavlinkSigner(KEY, 1).sign(heartbeat()), VEHICLE, 0.0)
    assert found.signs


class Kernel:
    """A socket whose kernel grants so many bytes of receive buffer."""

    def __init__(self, most):
        self.most, self.granted = most, min(212_992, most)

    def setsockopt(self, _level, option, value):
        if option != socket.SO_RCVBUF:
            raise PermissionError
        self.granted = min(2 * value, self.most)  # Linux doubles it

    def getsockopt(self, _level, _option):
        return self.granted


def test_a_buffer_that_the_kernel_grants_is_not_logged(caplog):
    assert widen(Kernel(1 << 30)) == SOCKET_BUFFER_S
    assert caplog.text == ""


def test_a_buffer_that_the_kernel_does_not_grant_is_logged_with_what_to_do(caplog):
    assert widen(Kernel(425_984)) == pytest.approx(1.25, abs=0.01)
    assert "keeps 1.2 s" in caplog.text
    assert f"sysctl -w net.core.rmem_max={RECEIVE_BYTES // 2}" in caplog.text


def test_a_real_socket_keeps_what_widen_reports():
    """Datagrams as a PX4 sends them, while nothing reads them: the oldest, until it is full."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
    ):
        bound.bind(("127.0.0.1", 0))
        kept_s = widen(bound)
        bound.setblocking(False)
        wanted = round(kept_s * 410 * 0.9)
        for number in range(wanted):
            vehicle.sendto(number.to_bytes(4, "little") + bytes(56), bound.getsockname())
        found = [int.from_bytes(bound.recv(100)[:4], "little") for _ in range(wanted)]
    assert found == list(range(wanted))
