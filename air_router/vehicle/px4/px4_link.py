"""The UDP end of the vehicle's link: one peer, learned once and kept.

MAVSDK takes datagrams from every address, whatever system they claim to be, and answers all of
them. Here the first address that an autopilot's heartbeat of the wanted system comes from is the
vehicle's: datagrams from elsewhere are counted and left out, and nothing is sent elsewhere.
"""

import contextlib
import logging
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Final

_log = logging.getLogger(__name__)

ANEW_S: Final = 5.0
"""A peer that was silent for so long may come back on another port of the same host."""

LARGEST: Final = 65535  # bytes of a datagram

KEPT_S: Final = 20.0
"""For so long a full link is kept while this program stands still, where the kernel allows it."""

_RATE_HZ: Final = 410  # datagrams of a PX4 1.17 on its companion's link
_KEPT_BYTES: Final = 832  # that Linux counts for one of them: 256 fill its default of 212992
RECEIVE_BYTES: Final = round(KEPT_S * _RATE_HZ * _KEPT_BYTES)
"""Of the receive buffer, as Linux counts them; half of that is asked for, which it doubles."""

_FORCED: Final = 33  # SO_RCVBUFFORCE of Linux; needs CAP_NET_ADMIN
_HEARTBEAT: Final = 0
_AUTOPILOT: Final = 1
_MAVLINK_1, _MAVLINK_2 = 0xFE, 0xFD
_SIGNED: Final = 1

Address = tuple[str, int]


def frames(datagram: bytes) -> Iterator[tuple[int, int, int]]:
    """System id, component id and message id of the MAVLink frames in a datagram, in order."""
    at = 0
    while at + 8 <= len(datagram):
        magic, length = datagram[at], datagram[at + 1]
        if magic == _MAVLINK_1:
            system, component, number = datagram[at + 3 : at + 6]
            at += length + 8
        elif magic == _MAVLINK_2 and at + 12 <= len(datagram):
            system, component = datagram[at + 5], datagram[at + 6]
            number = int.from_bytes(datagram[at + 7 : at + 10], "little")
            at += length + (25 if datagram[at + 2] & _SIGNED else 12)
        else:
            return
        if at <= len(datagram):
            yield system, component, number


def widen(bound: socket.socket) -> float:
    """Have a socket keep the datagrams of `KEPT_S`; returns for how many seconds it does.

    A socket that is full drops the newest, in which a pilot's mode may be. What the kernel does not
    grant is logged: a flight asks for the mode before each order, and needs no buffer for that, but
    what was announced in a long standstill may be lost.
    """
    for option in (_FORCED, socket.SO_RCVBUF):
        with contextlib.suppress(OSError):  # no permission, or not Linux
            bound.setsockopt(socket.SOL_SOCKET, option, RECEIVE_BYTES // 2)
        granted = bound.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        if granted >= RECEIVE_BYTES // 2 * 2:
            return KEPT_S
    kept_s = granted / _KEPT_BYTES / _RATE_HZ
    _log.warning(
        "the kernel keeps %.1f s of the vehicle's messages while this program stands still, not "
        "%.0f s: allow more with `sudo sysctl -w net.core.rmem_max=%d`",
        kept_s,
        KEPT_S,
        RECEIVE_BYTES // 2,
    )
    return kept_s


class PeerFilter:
    """Which datagrams are the vehicle's. Has no socket and no clock.

    Attributes:
        peer: The vehicle's address, None before it was heard.
        refused: How many datagrams from elsewhere were left out.
    """

    def __init__(self, system_id: int) -> None:
        self.peer: Address | None = None
        self.refused = 0
        self._system_id = system_id
        self._heard_s = 0.0  # when the peer was heard last

    def takes(self, datagram: bytes, source: Address, now_s: float) -> bool:
        """Whether a datagram is listened to; before the vehicle is known all are."""
        if source == self.peer:
            self._heard_s = now_s
            return True
        if self.peer is None or (source[0] == self.peer[0] and now_s - self._heard_s > ANEW_S):
            if (self._system_id, _AUTOPILOT, _HEARTBEAT) in frames(datagram):
                self.peer, self._heard_s = source, now_s
                _log.info("the vehicle is at %s:%d", *source)
                return True
            return self.peer is None
        self.refused += 1
        if self.refused == 1:
            _log.warning(
                "MAVLink comes from %s:%d as well, which is not the vehicle's address %s:%d; it "
                "is not listened to",
                *source,
                *self.peer,
            )
        return False


class Px4Link:
    """A UDP port, and a thread that hands on what the vehicle sends there.

    Args:
        bound: The port; closed with the link.
        system_id: The vehicle's.
        receive: Takes what it sends, on the link's thread.
    """

    def __init__(
        self, bound: socket.socket, system_id: int, receive: Callable[[bytes], None]
    ) -> None:
        widen(bound)
        self._socket = bound
        self._filter = PeerFilter(system_id)
        self._receive = receive
        self._waker, self._woken = socket.socketpair()  # wake the thread to end it
        self._thread = threading.Thread(target=self._run, name="MAVLink", daemon=True)
        self._thread.start()

    def send(self, frame: bytes) -> None:
        """Send to the vehicle; before it is known, and where the network is away, to no one."""
        peer = self._filter.peer
        if peer is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(frame, peer)

    def close(self) -> None:
        """End the thread, then close the port."""
        self._waker.send(b"\0")
        self._thread.join()
        for each in (self._socket, self._waker, self._woken):
            each.close()

    def _run(self) -> None:
        while True:
            ready, _, _ = select.select([self._socket, self._woken], [], [])
            if self._woken in ready:
                return
            try:
                datagram, source = self._socket.recvfrom(LARGEST)
            except OSError:
                continue  # an ICMP error of an earlier datagram
            if self._filter.takes(datagram, source[:2], time.monotonic()):
                self._receive(datagram)
