"""The link to a given end: over a real UDP port, TCP server and pseudo terminal."""

import contextlib
import os
import pty
import queue
import socket
import termios

import pytest
from pymavlink.dialects.v20 import common as mavlink

from air_router.vehicle.px4.direct_link import DirectLink, opened
from air_router.vehicle.px4.mavlink_frame import frames_of
from air_router.vehicle.px4.mavlink_signing import MavlinkSigner, Verdict
from air_router.vehicle.px4.signing_key import SigningKey

KEY = SigningKey(bytes(range(1, 33)))
LIMIT_S = 20  # against hangs only


def heartbeat(system=1):
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    return bytes(mavlink.MAVLink_heartbeat_message(2, 12, 128, 0, 4, 3).pack(link))


def signer():
    return MavlinkSigner(KEY, 1)


class Linked:
    """A link, and what it hands on."""

    def __init__(self, url):
        self.received = queue.Queue()
        self.signer = signer()
        self.link = DirectLink(url, self.received.put, self.signer)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.link.close()

    def exchanges(self, send, receive):
        """Signed both ways; what is not signed goes nowhere."""
        vehicle = signer()
        send(heartbeat())
        send(vehicle.sign(heartbeat()))
        assert self.received.get(timeout=LIMIT_S) == heartbeat()
        assert self.received.empty()
        assert self.signer.counts == {Verdict.UNSIGNED: 1, Verdict.GOOD: 1}
        self.link.send(heartbeat(9))
        assert vehicle.received(receive()) == heartbeat(9)


def test_over_udp():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(LIMIT_S)
        with Linked(f"udpout://127.0.0.1:{vehicle.getsockname()[1]}") as linked:
            linked.link.send(heartbeat(9))
            _, us = vehicle.recvfrom(300)
            linked.exchanges(lambda data: vehicle.sendto(data, us), lambda: vehicle.recv(300))


def test_over_tcp_that_is_lost_and_comes_back():
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(LIMIT_S)
        with Linked(f"tcpout://127.0.0.1:{server.getsockname()[1]}") as linked:
            for _ in range(2):
                vehicle, _ = server.accept()
                with vehicle:
                    vehicle.settimeout(LIMIT_S)
                    vehicle.sendall(b"garbage")
                    linked.signer.counts.clear()
                    linked.exchanges(vehicle.sendall, lambda v=vehicle: v.recv(300))


@pytest.fixture
def terminal():
    ours, theirs = pty.openpty()
    try:
        yield ours, os.ttyname(theirs)
    finally:
        os.close(ours)
        os.close(theirs)


def test_over_a_serial_line_of_raw_bytes(terminal):
    vehicle, device = terminal
    with Linked(f"serial://{device}:921600") as linked:
        linked.exchanges(lambda data: os.write(vehicle, data), lambda: os.read(vehicle, 300))
        settings = termios.tcgetattr(vehicle)
        assert settings[4:6] == [termios.B921600] * 2
        assert not settings[3] & (termios.ECHO | termios.ICANON)


def test_flow_control_is_that_of_the_url(terminal):
    _, device = terminal
    for kind, wanted in (("serial_flowcontrol", True), ("serial", False)):
        line = opened(f"{kind}://{device}:57600")
        assert bool(termios.tcgetattr(line.fileno())[2] & termios.CRTSCTS) is wanted
        line.close()


def everything(terminal):
    """What waits at the other end."""
    os.set_blocking(terminal, False)
    got = b""
    with contextlib.suppress(BlockingIOError):
        while True:
            got += os.read(terminal, 65536)
    return got


def test_a_line_that_takes_no_more_gets_whole_frames_only(terminal):
    """Nothing reads it for a while: no frame is torn, and the link goes on."""
    vehicle, device = terminal
    with Linked(f"serial://{device}:57600") as linked:
        for _ in range(2000):
            linked.link.send(heartbeat(9))
        got = everything(vehicle)
        for _ in range(2):
            linked.link.send(heartbeat(9))
        got += everything(vehicle)
        taken = list(frames_of(signer().received(got)))
        assert set(taken) == {heartbeat(9)}
        assert got == b"".join(frames_of(got))
        assert 2 < len(taken) < 2000


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("udpout://127.0.0.1:0", "a port from 1 to 65535"),
        ("tcpout://5760", "write tcpout://HOST:PORT"),
        ("serial:///dev/null:57601", "57601 baud is no rate"),
        ("tcpin://127.0.0.1:5760", "a signed link is"),
    ],
)
def test_the_error_of_a_url_that_cannot_be_opened_has_what_to_write(url, words):
    with pytest.raises(ValueError, match=words):
        opened(url)


def test_what_is_no_serial_line_is_an_error_of_the_system():
    with pytest.raises(OSError, match="Inappropriate ioctl"):
        opened("serial:///dev/null:57600")
