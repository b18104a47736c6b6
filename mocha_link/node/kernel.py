"""What the kernel knows and does of sockets, also of those of libzmq, and waiting for them."""

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

DATAGRAM_BYTES = 1500

# Of struct tcp_info, linux/tcp.h (since 4.6): packets sent again and round trip, min_rtt in us
# (2**32 - 1 while there is none), packets with data.
_TOTAL_RETRANS_AT, _MIN_RTT_AT, _DATA_SEGS_OUT_AT = 100, 148, 156
_LEAST_PACKETS = 50  # a share of losses is taken from at least so many
# So much of what it sends is lost before a congestion control slows down too much. BBR bears more
# loss than the datagrams' pacing; CUBIC and Reno take each loss for a full link.
_HEAVY_LOSS = {b"bbr": 0.15}
_HEAVY_LOSS_OF_OTHERS = 0.03
_CONGESTION_CONTROL = b"bbr"
_BACKLOG = 100  # as libzmq has it
_NO_RTT_US = 2**32 - 1
_RETRANSMITS_AT = 2  # u8: how often in a row what it sends was sent again without an answer
_IP_MTU_DISCOVER, _IP_PMTUDISC_DONT = 10, 0  # linux/in.h
_IPV6_MTU_DISCOVER = 23  # linux/in6.h
_IP_FREEBIND = 15  # linux/in.h
_AT_ONCE = struct.pack("ii", 1, 0)  # struct linger


def descriptors_lacking(count: int) -> int:
    """How many of `count` further descriptors the process may not open.

    Its soft limit is raised as far as the hard one allows, if need be.
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
        with contextlib.suppress(OSError):  # closed already
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)


def rtt_s(connection: socket.socket | None) -> float | None:
    """Its round-trip time: the least one of late, which no queue has lengthened."""
    rtt_us = _tcp_info(connection, "=I", _MIN_RTT_AT)
    return rtt_us / 1e6 if rtt_us and rtt_us != _NO_RTT_US else None


def unanswered(connection: socket.socket | None) -> int:
    """How often in a row what it sends was sent again without an acknowledgement."""
    return _tcp_info(connection, "=B", _RETRANSMITS_AT) or 0


def loses_much(connection: socket.socket | None) -> bool:
    """Whether so much of what it sends is lost that its congestion control hardly sends."""
    sent = _tcp_info(connection, "=I", _DATA_SEGS_OUT_AT) or 0
    again = _tcp_info(connection, "=I", _TOTAL_RETRANS_AT) or 0
    if connection is None or sent < _LEAST_PACKETS:
        return False
    try:
        name = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, 16)
    except (OSError, AttributeError):
        return False
    heavy = _HEAVY_LOSS.get(name.partition(b"\0")[0], _HEAVY_LOSS_OF_OTHERS)
    return again > heavy * sent


def _tcp_info(connection: socket.socket | None, layout: str, offset: int) -> int | None:
    if connection is None:
        return None
    try:
        info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
        value: int = struct.unpack_from(layout, info, offset)[0]
    except (OSError, AttributeError, struct.error):  # closed, or not Linux
        return None
    return value


def bear_losses(connection: socket.socket) -> None:
    """Use BBR where the kernel has it; the kernel's own choice elsewhere."""
    with contextlib.suppress(OSError, AttributeError):  # the module is not there; not Linux
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, _CONGESTION_CONTROL)


def let_address_come_later(unbound: socket.socket) -> None:
    """Let it be bound to an address that the machine does not have yet. OSError: not on Linux."""
    unbound.setsockopt(socket.IPPROTO_IP, _IP_FREEBIND, 1)  # of IPv6 sockets, too


def _unbound(host: str, kind: socket.SocketKind) -> socket.socket:
    """A socket for an address of this machine, or for all: IPv4 and IPv6 where both are there."""
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
    """Bind it to an address, or to all. Raises OSError."""
    if host == ANY:
        host = "::" if unbound.family == socket.AF_INET6 else "0.0.0.0"  # noqa: S104 - all
    unbound.bind(socket_address(host, port))


def is_ours(host: str) -> bool:
    """Whether this machine has an address now."""
    try:
        with socket.socket(family_of(host), socket.SOCK_DGRAM) as probe:
            probe.bind(socket_address(host, 0))
    except OSError:
        return False
    return True


def tune(connection: socket.socket, dead_s: int) -> None:
    """Send small frames at once, and detect a dead peer within so many seconds."""
    closed_in_children(connection).setblocking(False)
    bear_losses(connection)
    with contextlib.suppress(OSError):  # the connection is closed already
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        if sys.platform == "linux":
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, dead_s // 2)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, dead_s // 6)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, dead_s * 1000)


def listener(address: str, port: int, *, early: bool = False) -> socket.socket:
    """Listens on an address, or on all (``*``); `early`: on one that the machine lacks yet, too.

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
    """A socket for datagrams, at a port of an address (``*``: all) or at any free one.

    The address need not be there yet. Datagrams are cut in parts where a link takes less than their
    size, not thrown away. Raises OSError.
    """
    datagrams = closed_in_children(_unbound(listen, socket.SOCK_DGRAM))
    try:
        if buffer_bytes:
            datagrams.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
        with contextlib.suppress(OSError):  # not Linux: its own way is as good
            datagrams.setsockopt(socket.IPPROTO_IP, _IP_MTU_DISCOVER, _IP_PMTUDISC_DONT)
            if datagrams.family == socket.AF_INET6:
                datagrams.setsockopt(socket.IPPROTO_IPV6, _IPV6_MTU_DISCOVER, _IP_PMTUDISC_DONT)
        if listen != ANY:
            with contextlib.suppress(OSError):  # not Linux; then the address was there
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
    """What a socket of `datagram_socket` takes for an address; None: it does not reach it."""
    if datagrams.family == socket.AF_INET:
        return None if ":" in host else (host, port)
    mapped = not datagrams.getsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY)
    if ":" not in host and not mapped:
        return None
    try:
        return socket_address(host, port, mapped=True)
    except OSError:  # the interface has gone
        return None


def received(datagrams: socket.socket, limit: int) -> Iterator[tuple[bytes, SocketAddress]]:
    """The datagrams that have come, up to so many, and where from."""
    for _ in range(limit):
        try:
            packet, source = datagrams.recvfrom(DATAGRAM_BYTES)
        except BlockingIOError:
            return
        except OSError:
            continue  # an ICMP error of an earlier datagram
        yield packet, source


# Waits for many sockets and reports the owners of ready ones: a turn costs only the ready ones.


Polled = int
"""A descriptor."""


class Poller:
    """Waits for descriptors. One must be taken out before it is closed."""

    def __init__(self) -> None:
        self._selector = closed_in_children(selectors.DefaultSelector())

    def fileno(self) -> int:
        """A descriptor that is readable when something is ready, for the loop of another."""
        number = getattr(self._selector, "fileno", None)
        assert number is not None  # noqa: S101 - epoll has one, and so has kqueue
        return int(number())

    def register(self, each: Polled, flags: int, owner: Hashable = None) -> None:
        """Wait for a descriptor that belongs to an owner, from now on for these events."""
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
        """Wait for a descriptor no longer. KeyError if it is not waited for."""
        self._selector.unregister(each)

    def poll(self, wait_ms: int | None) -> dict[Polled, Hashable]:
        """Wait until something is ready, at most so many milliseconds: what is, and whose.

        None waits for ever.
        """
        wait_s = None if wait_ms is None else wait_ms / 1000
        return {key.fd: key.data for key, _ in self._selector.select(wait_s)}

    def close(self) -> None:
        """Give up everything."""
        self._selector.close()
