"""Socket options, TCP statistics of the kernel, and a poller."""

from __future__ import annotations

import contextlib
import errno
import resource
import selectors
import socket
import struct
import sys
from collections.abc import Hashable, Iterator
from pathlib import Path

import zmq

from mocha_link.forks import closed_in_children
from mocha_link.hosts import ANY, SocketAddress, family_of, socket_address
from mocha_link.sync import Standing

DATAGRAM_BYTES = 1500

# Offsets in struct tcp_info, linux/tcp.h (since 4.6): retransmitted packets, min_rtt in us
# (2**32 - 1: not measured), data packets sent, bytes that wait to be sent.
_TOTAL_RETRANS_AT, _MIN_RTT_AT, _DATA_SEGS_OUT_AT, _NOTSENT_AT = 100, 148, 156, 144
_LEAST_PACKETS = 50  # the loss ratio needs at least this many packets
# The loss ratio above which a congestion control becomes too slow. BBR tolerates more loss than the
# datagrams' pacing; CUBIC and Reno interpret each loss as congestion.
_HEAVY_LOSS = {b"bbr": 0.15}
_HEAVY_LOSS_OF_OTHERS = 0.03
_CONGESTION_CONTROL = b"bbr"
_BACKLOG = 100  # the default of libzmq
_NO_RTT_US = 2**32 - 1
_RETRANSMITS_AT = 2  # u8: consecutive retransmissions without an acknowledgement
_IP_MTU_DISCOVER, _IP_PMTUDISC_DONT = 10, 0  # linux/in.h
_IPV6_MTU_DISCOVER = 23  # linux/in6.h
_IP_FREEBIND = 15  # linux/in.h
_AT_ONCE = struct.pack("ii", 1, 0)  # struct linger


def descriptors_lacking(count: int) -> int:
    """How many of `count` further descriptors the process may not open.

    Raises its soft limit if necessary, at most to the hard limit.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    open_now = Path("/proc/self/fd")
    needed = count + (len(list(open_now.iterdir())) if open_now.is_dir() else 0)
    if needed <= soft or soft == resource.RLIM_INFINITY:
        return 0
    allowed = needed if hard == resource.RLIM_INFINITY else min(needed, hard)
    resource.setrlimit(resource.RLIMIT_NOFILE, (allowed, hard))
    return needed - allowed


def reset(connection: socket.socket | None) -> None:
    """Make the kernel discard unsent bytes when the connection is closed."""
    if connection is not None:
        with contextlib.suppress(OSError):  # already closed
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)


def standing(connection: socket.socket | None) -> Standing:
    """The kernel's measurements of a connection; its round trip is the lowest recent one."""
    info = _tcp_info(connection)
    return Standing(_loses_much(connection, info), _rtt_s(info), _field(info, "=I", _NOTSENT_AT))


def rtt_s(connection: socket.socket | None) -> float | None:
    """The lowest recent round-trip time, which excludes queueing."""
    return _rtt_s(_tcp_info(connection))


def unanswered(connection: socket.socket | None) -> int:
    """The number of consecutive retransmissions without an acknowledgement."""
    return _field(_tcp_info(connection), "=B", _RETRANSMITS_AT) or 0


def _rtt_s(info: bytes) -> float | None:
    rtt_us = _field(info, "=I", _MIN_RTT_AT)
    return rtt_us / 1e6 if rtt_us and rtt_us != _NO_RTT_US else None


def _loses_much(connection: socket.socket | None, info: bytes) -> bool:
    """Whether losses slow its congestion control down to almost nothing."""
    sent = _field(info, "=I", _DATA_SEGS_OUT_AT) or 0
    again = _field(info, "=I", _TOTAL_RETRANS_AT) or 0
    if connection is None or sent < _LEAST_PACKETS:
        return False
    try:
        name = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, 16)
    except (OSError, AttributeError):
        return False
    heavy = _HEAVY_LOSS.get(name.partition(b"\0")[0], _HEAVY_LOSS_OF_OTHERS)
    return again > heavy * sent


def _tcp_info(connection: socket.socket | None) -> bytes:
    """The kernel's struct tcp_info; empty: not known."""
    if connection is None:
        return b""
    try:
        return connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
    except (OSError, AttributeError):  # closed, or not Linux
        return b""


def _field(info: bytes, layout: str, offset: int) -> int | None:
    """A field of struct tcp_info; None: not known, or the kernel is older than the field."""
    try:
        value: int = struct.unpack_from(layout, info, offset)[0]
    except struct.error:
        return None
    return value


def bear_losses(connection: socket.socket) -> None:
    """Use BBR where the kernel has it, and the kernel's default elsewhere."""
    with contextlib.suppress(OSError, AttributeError):  # no BBR module, or not Linux
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, _CONGESTION_CONTROL)


def let_address_come_later(unbound: socket.socket) -> None:
    """Allow binding to an address that the machine does not have yet. OSError: not on Linux."""
    unbound.setsockopt(socket.IPPROTO_IP, _IP_FREEBIND, 1)  # also applies to IPv6 sockets


def _unbound(host: str, kind: socket.SocketKind) -> socket.socket:
    """A socket for one address of this machine, or for all, IPv4 and IPv6 where available."""
    if host != ANY:
        made = socket.socket(family_of(host), kind)
        if made.family == socket.AF_INET6:
            made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        return made
    try:
        made = socket.socket(socket.AF_INET6, kind)
    except OSError:  # a kernel without IPv6
        return socket.socket(socket.AF_INET, kind)
    made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
    return made


def _bind(unbound: socket.socket, host: str, port: int) -> None:
    """Bind a socket to one address, or to all. Raises OSError."""
    if host == ANY:
        host = "::" if unbound.family == socket.AF_INET6 else "0.0.0.0"  # noqa: S104 - all
    unbound.bind(socket_address(host, port))


def is_ours(host: str) -> bool:
    """Whether this machine currently has an address."""
    try:
        with socket.socket(family_of(host), socket.SOCK_DGRAM) as probe:
            probe.bind(socket_address(host, 0))
    except OSError:
        return False
    return True


def tune(connection: socket.socket, dead_s: int) -> None:
    """Send small frames at once, and detect a dead peer within `dead_s` seconds."""
    closed_in_children(connection).setblocking(False)
    bear_losses(connection)
    with contextlib.suppress(OSError):  # the connection is already closed
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        if sys.platform == "linux":
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, dead_s // 2)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, dead_s // 6)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, dead_s * 1000)


def listener(address: str, port: int, *, early: bool = False) -> socket.socket:
    """Listen on an address, or on all (``*``); `early`: the machine may not have it yet.

    Raises OSError.
    """
    made = closed_in_children(_unbound(address, socket.SOCK_STREAM))
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if early:
            let_address_come_later(made)
        made.setblocking(False)
        _bind(made, address, port)
        made.listen(_BACKLOG)
    except OSError as error:
        made.close()
        if address == ANY and error.errno == errno.EADDRNOTAVAIL:  # IPv6 is switched off
            return listener("0.0.0.0", port, early=early)  # noqa: S104 - all there is
        raise
    return made


def datagram_socket(listen: str, number: int = 0, buffer_bytes: int = 0) -> socket.socket:
    """A socket for datagrams, bound to an address (``*``: all) and a port (0: any free one).

    The machine may not have the address yet. Datagrams larger than a link's MTU are fragmented, not
    dropped. Raises OSError.
    """
    datagrams = closed_in_children(_unbound(listen, socket.SOCK_DGRAM))
    try:
        if buffer_bytes:
            datagrams.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
        with contextlib.suppress(OSError):  # not Linux: the default is acceptable
            datagrams.setsockopt(socket.IPPROTO_IP, _IP_MTU_DISCOVER, _IP_PMTUDISC_DONT)
            if datagrams.family == socket.AF_INET6:
                datagrams.setsockopt(socket.IPPROTO_IPV6, _IPV6_MTU_DISCOVER, _IP_PMTUDISC_DONT)
        if listen != ANY:
            with contextlib.suppress(OSError):  # not Linux: the address must exist
                let_address_come_later(datagrams)
        _bind(datagrams, listen, number)
        datagrams.setblocking(False)
    except OSError as error:
        datagrams.close()
        if listen == ANY and error.errno == errno.EADDRNOTAVAIL:  # IPv6 is switched off
            return datagram_socket("0.0.0.0", number, buffer_bytes)  # noqa: S104 - all there is
        raise
    return datagrams


def destination(datagrams: socket.socket, host: str, port: int) -> SocketAddress | None:
    """An address in the form that a socket of `datagram_socket` accepts; None: not reachable."""
    if datagrams.family == socket.AF_INET:
        return None if ":" in host else (host, port)
    mapped = not datagrams.getsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY)
    if ":" not in host and not mapped:
        return None
    try:
        return socket_address(host, port, mapped=True)
    except OSError:  # the interface no longer exists
        return None


def received(datagrams: socket.socket, limit: int) -> Iterator[tuple[bytes, SocketAddress]]:
    """Yield at most `limit` received datagrams with their source addresses."""
    for _ in range(limit):
        try:
            packet, source = datagrams.recvfrom(DATAGRAM_BYTES)
        except BlockingIOError:
            return
        except OSError:
            continue  # an ICMP error for an earlier datagram
        yield packet, source


# The poller reports the owners of ready sockets, so that a turn costs only the ready ones.


Polled = int
"""A descriptor."""


class Poller:
    """Waits for descriptors. A descriptor must be unregistered before it is closed."""

    def __init__(self) -> None:
        self._selector = closed_in_children(selectors.DefaultSelector())

    def fileno(self) -> int:
        """A descriptor that is readable when something is ready, for another event loop."""
        number = getattr(self._selector, "fileno", None)
        assert number is not None  # noqa: S101 - epoll has one, and so has kqueue
        return int(number())

    def register(self, each: Polled, flags: int, owner: Hashable = None) -> None:
        """Wait for these events of a descriptor from now on, and report them with `owner`."""
        events = selectors.EVENT_READ if flags & zmq.POLLIN else 0
        events |= selectors.EVENT_WRITE if flags & zmq.POLLOUT else 0
        known = self._selector.get_map().get(each)
        if known is None:
            if events:
                self._selector.register(each, events, owner)
        elif events == 0:
            self._selector.unregister(each)
        elif known.events != events or known.data != owner:
            self._selector.modify(each, events, owner)

    def unregister(self, each: Polled) -> None:
        """Stop waiting for a descriptor. Raises KeyError if it is not registered."""
        self._selector.unregister(each)

    def poll(self, wait_ms: int | None) -> dict[Polled, Hashable]:
        """Wait at most `wait_ms` (None: for ever); returns ready descriptors with their owners."""
        wait_s = None if wait_ms is None else wait_ms / 1000
        return {key.fd: key.data for key, _ in self._selector.select(wait_s)}

    def close(self) -> None:
        """Release the selector."""
        self._selector.close()
