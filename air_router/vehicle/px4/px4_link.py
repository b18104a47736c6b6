"""The UDP end of the vehicle's link, with one peer that is learned once and kept.

MAVSDK accepts datagrams from every address and answers all of them. Here the first address that
sends an autopilot's heartbeat with the requested system id is the vehicle's. Datagrams from other
addresses are counted and dropped, and nothing is sent there.
"""

import contextlib
import logging
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Final

from air_router.vehicle.px4.limits import (
    DATAGRAM_BUFFER_BYTES,
    LINK_DATAGRAMS_HZ,
    PEER_PORT_ANEW_S,
    READ_BYTES,
    SOCKET_BUFFER_S,
)
from air_router.vehicle.px4.mavlink_frame import Header, frames_of, header_of, is_signed
from air_router.vehicle.px4.mavlink_signing import MavlinkSigner
from air_router.vehicle.px4.mavlink_values import AUTOPILOT, SO_RCVBUFFORCE, MessageId

_log = logging.getLogger(__name__)


RECEIVE_BYTES: Final = round(SOCKET_BUFFER_S * LINK_DATAGRAMS_HZ * DATAGRAM_BUFFER_BYTES)
"""Size of the receive buffer, as Linux counts it; half of it is requested, which Linux doubles."""


Address = tuple[str, int]


def frames(datagram: bytes) -> Iterator[Header]:
    """System id, component id and message id of the MAVLink frames in a datagram, in order."""
    return map(header_of, frames_of(datagram))


def widen(bound: socket.socket) -> float:
    """Enlarge a socket's buffer to `SOCKET_BUFFER_S` of datagrams; return the seconds it holds.

    A full socket drops the newest datagrams, perhaps with a pilot's mode. If the kernel does not
    grant the size, this is logged. A flight requests the mode before each command and does not
    depend on the buffer, but other messages of a long stall may be lost.
    """
    for option in (SO_RCVBUFFORCE, socket.SO_RCVBUF):
        with contextlib.suppress(OSError):  # no permission, or not Linux
            bound.setsockopt(socket.SOL_SOCKET, option, RECEIVE_BYTES // 2)
        granted = bound.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        if granted >= RECEIVE_BYTES // 2 * 2:
            return SOCKET_BUFFER_S
    buffered_s = granted / DATAGRAM_BUFFER_BYTES / LINK_DATAGRAMS_HZ
    _log.warning(
        "the kernel keeps %.1f s of the vehicle's messages while this program stands still, not "
        "%.0f s: allow more with `sudo sysctl -w net.core.rmem_max=%d`",
        buffered_s,
        SOCKET_BUFFER_S,
        RECEIVE_BYTES // 2,
    )
    return buffered_s


class PeerFilter:
    """Decides which datagrams are the vehicle's. Has no socket and no clock.

    Attributes:
        peer: The vehicle's address; None before its first heartbeat.
        refused: Number of dropped datagrams from other addresses.
        signs: The vehicle signed its first heartbeat.
    """

    def __init__(self, system_id: int) -> None:
        self.peer: Address | None = None
        self.refused = 0
        self.signs = False
        self._system_id = system_id
        self._received_s = 0.0  # when the peer was last received

    def takes(self, datagram: bytes, source: Address, now_s: float) -> bool:
        """Whether to accept a datagram; before the vehicle is known all are accepted."""
        if source == self.peer:
            self._received_s = now_s
            return True
        if (peer := self.peer) is None or self.may_be_at(source, now_s):
            if Header(self._system_id, AUTOPILOT, MessageId.HEARTBEAT) in frames(datagram):
                self.peer, self._received_s = source, now_s
                self.signs = any(map(is_signed, frames_of(datagram)))
                _log.info("the vehicle is at %s:%d", *source)
                return True
            return peer is None
        self.refused += 1
        if self.refused == 1:
            _log.warning(
                "MAVLink is also received from %s:%d, which is not the vehicle's address %s:%d; "
                "its messages are ignored",
                *source,
                *peer,
            )
        return False

    def may_be_at(self, source: Address, now_s: float) -> bool:
        """Whether the vehicle may be at this address, if it sends a heartbeat from there."""
        if self.peer is None or source == self.peer:
            return True
        return source[0] == self.peer[0] and now_s - self._received_s > PEER_PORT_ANEW_S


class Px4Link:
    """A UDP port, and a thread that passes on what the vehicle sends to it.

    Args:
        bound: The bound socket; closed with the link.
        system_id: The vehicle's.
        receive: Called with the vehicle's datagrams, on the link's thread.
        signer: Signs sent frames; only frames with a valid signature are the vehicle's.
    """

    def __init__(
        self,
        bound: socket.socket,
        system_id: int,
        receive: Callable[[bytes], None],
        signer: MavlinkSigner | None = None,
    ) -> None:
        widen(bound)
        self._socket = bound
        self._filter = PeerFilter(system_id)
        self._receive, self._signer = receive, signer
        self._sending = threading.Lock()  # signed frames are sent in the order of their timestamps
        self._restarted: Address | None = None  # a vehicle with old signatures
        self._waker, self._woken = socket.socketpair()  # wake the thread to end it
        self._thread = threading.Thread(target=self._run, name="MAVLink", daemon=True)
        self._thread.start()

    @property
    def signed_unasked(self) -> bool:
        """Whether the vehicle signs although the link has no key: it ignores everything sent."""
        return self._filter.signs

    def send(self, frame: bytes) -> None:
        """Send to the vehicle; does nothing before the vehicle is known or without a network.

        A restarted vehicle signs with old timestamps until it receives a newer one. It gets only
        our heartbeats until then, because everything received from it may be a replay.
        """
        peer, restarted = self._filter.peer, self._restarted
        with self._sending:
            if peer is not None:
                self._send_to(frame, peer)
            if restarted is not None and restarted != peer and _is_heartbeat(frame):
                self._send_to(frame, restarted)

    def close(self) -> None:
        """End the thread, then close the port."""
        self._waker.send(b"\0")
        self._thread.join()
        for each in (self._socket, self._waker, self._woken):
            each.close()

    def _send_to(self, frame: bytes, to: Address) -> None:
        signed = frame if self._signer is None else self._signer.sign(frame)
        with contextlib.suppress(OSError):
            self._socket.sendto(signed, to)

    def _vouched_for(self, datagram: bytes, source: Address, now_s: float) -> bytes:
        """The frames with a valid signature; datagrams from other addresses are not verified."""
        signer = self._signer
        if signer is None or not self._filter.may_be_at(source, now_s):
            return datagram
        taken = signer.received(datagram)
        if signer.stale_heartbeat:
            self._restarted = source
        return taken

    def _run(self) -> None:
        while True:
            ready, _, _ = select.select([self._socket, self._woken], [], [])
            if self._woken in ready:
                return
            try:
                datagram, source = self._socket.recvfrom(READ_BYTES)
            except OSError:
                continue  # an ICMP error of an earlier datagram
            now_s = time.monotonic()
            if not (taken := self._vouched_for(datagram, source[:2], now_s)) and datagram:
                continue
            if self._filter.takes(taken, source[:2], now_s):
                self._restarted = None
                self._receive(taken)


def _is_heartbeat(frame: bytes) -> bool:
    return any(each.message_id == MessageId.HEARTBEAT for each in frames(frame))
