"""A signed link to a vehicle at a given address: UDP, a TCP server, or a serial line.

MAVSDK opens such links itself. On a signed link all messages have to pass through this module.
"""

import contextlib
import logging
import os
import select
import socket
import termios
import threading
import tty
from collections.abc import Callable
from typing import Protocol

from air_router.vehicle.px4.limits import LINE_REOPENED_S, READ_BYTES, SERIAL_BAUD, TCP_CONNECT_S
from air_router.vehicle.px4.mavlink_signing import MavlinkSigner, SignedStream

_log = logging.getLogger(__name__)


class Channel(Protocol):
    """An open descriptor to read and write."""

    def fileno(self) -> int:
        """The descriptor."""

    def close(self) -> None:
        """Close it."""


class DirectLink:
    """A channel, and a thread that passes on what it receives.

    Args:
        url: The other end: `udpout://HOST:PORT`, `tcpout://HOST:PORT`, `serial://DEVICE:RATE` or
            `serial_flowcontrol://DEVICE:RATE`.
        receive: Called with whole frames with a valid signature, on the link's thread.
        signer: Signs and verifies.

    Raises:
        OSError: it cannot be opened.
        ValueError: The URL is none of these; the message gives the reason.
    """

    def __init__(self, url: str, receive: Callable[[bytes], None], signer: MavlinkSigner) -> None:
        self._url, self._receive, self._signer = url, receive, signer
        self._channel: Channel | None = opened(url)  # None: lost
        self._is_stream = not url.startswith("udp")
        self._stream = SignedStream(signer)
        self._rest = b""  # of a frame that was written in part
        self._sending = threading.Lock()  # signed frames leave in the order of their times
        self._waker, self._woken = socket.socketpair()  # wake the thread to end it
        self._thread = threading.Thread(target=self._run, name="MAVLink", daemon=True)
        self._thread.start()

    def send(self, frame: bytes) -> None:
        """Send to the vehicle; a frame is lost if the channel is full or lost."""
        with self._sending:
            if self._channel is None:
                return
            try:
                if self._rest:
                    self._rest = self._rest[os.write(self._channel.fileno(), self._rest) :]
                if not self._rest:
                    signed = self._signer.sign(frame)
                    written = os.write(self._channel.fileno(), signed) if signed else 0
                    self._rest = signed[written:]
            except OSError:  # full, or lost, which reading detects
                return

    def close(self) -> None:
        """End the thread, then close the channel."""
        self._waker.send(b"\0")
        self._thread.join()
        self._close_channel()
        for each in (self._waker, self._woken):
            each.close()

    def _run(self) -> None:
        while True:
            channel = self._channel
            if channel is None:
                if select.select([self._woken], [], [], LINE_REOPENED_S)[0]:
                    return
                self._open_again()
                continue
            if self._woken in select.select([self._woken, channel], [], [])[0]:
                return
            try:
                data = os.read(channel.fileno(), READ_BYTES)
            except BlockingIOError:
                continue
            except OSError:
                data = b""  # lost; of UDP an ICMP error of an earlier datagram
            if data:
                taken = (self._stream if self._is_stream else self._signer).received(data)
                if taken:
                    self._receive(taken)
            elif self._is_stream:
                _log.warning("%s was lost; it is opened again", self._url)
                self._close_channel()

    def _close_channel(self) -> None:
        with self._sending:
            channel, self._channel, self._rest = self._channel, None, b""
            self._stream = SignedStream(self._signer)
        if channel is not None:
            channel.close()

    def _open_again(self) -> None:
        with contextlib.suppress(OSError):
            channel = opened(self._url)
            with self._sending:
                self._channel = channel
            _log.warning("%s is open again", self._url)


def opened(url: str) -> Channel:
    """Open the channel of a URL, non-blocking.

    Raises:
        OSError: it cannot be opened.
        ValueError: The URL is of another kind.
    """
    kind, _, end = url.partition("://")
    if kind.startswith("serial"):
        return _serial(end, flow_control=kind == "serial_flowcontrol")
    host, _, port = end.rpartition(":")
    if not host or not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise ValueError(f"write {kind}://HOST:PORT, with a port from 1 to 65535")
    if kind == "udpout":
        connection = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            connection.connect((host, int(port)))
        except OSError:
            connection.close()
            raise
    elif kind == "tcpout":
        connection = socket.create_connection((host, int(port)), TCP_CONNECT_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    else:
        raise ValueError(
            "a signed link is udpin://, udpout://, tcpout://, serial:// or serial_flowcontrol://"
        )
    connection.setblocking(False)
    return connection


def _serial(end: str, *, flow_control: bool) -> Channel:
    """A serial line: 8 bits, no parity, raw."""
    device, _, rate = end.rpartition(":")
    if not device:
        device, rate = end, str(SERIAL_BAUD)
    speed = getattr(termios, f"B{rate}", None) if rate.isdecimal() else None
    if speed is None:
        raise ValueError(f"{rate} baud is no rate of a serial line; PX4's are 57600 and 921600")
    line = open("/" + device.lstrip("/"), "r+b", buffering=0, opener=_open_line)  # noqa: SIM115 - `Path.open` takes no opener; closed with the link
    try:
        tty.setraw(line.fileno())
        settings = termios.tcgetattr(line.fileno())
        settings[2] |= termios.CLOCAL | termios.CREAD
        if flow_control:
            settings[2] |= termios.CRTSCTS
        else:
            settings[2] &= ~termios.CRTSCTS
        settings[4] = settings[5] = speed
        termios.tcsetattr(line.fileno(), termios.TCSANOW, settings)
    except termios.error as error:
        line.close()
        raise OSError(*error.args) from None
    return line


def _open_line(path: str, _flags: int) -> int:
    return os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
