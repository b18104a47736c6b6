"""Robots without an address in the team file are found by mDNS (RFC 6762, service discovery 6763).

A node announces ``_mocha-link._tcp``: its robot, the first of its ports, its addresses. Anyone on
the link can announce anything, so an announcement is only where to try: see `AddressBook`.
Needs the extra ``mdns`` (zeroconf), which is imported when a node uses it.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import os
import socket
import threading
from collections.abc import Callable, Collection, Sequence
from typing import Any, Final

from mocha_link.addresses.limits import CONFIRM_S, MAX_ANNOUNCEMENTS, MAX_OF_NAME, MDNS_CLOSE_S
from mocha_link.errors import Guard, needs_extra
from mocha_link.hosts import ANY, as_host, is_number
from mocha_link.team import Robot, Team

SERVICE: Final = "_mocha-link._tcp.local."
REQUEST_MS: Final = 3000
AGAIN_S: Final = 2.0  # after an error
_MAX_REQUESTS: Final = 16  # announcements that are completed at the same time


class Mdns:
    """Announces a robot, and collects where others are, on a thread of its own.

    Args:
        me: the robot of this node.
        announces: whether to announce it.
        wanted: robots to be found.
        wake: called from that thread when an address came or went.
        confirm_s: real seconds after a change of our own addresses in which an announcement from
            before must come again.

    Raises:
        MissingExtraError: zeroconf is not installed.
    """

    def __init__(  # noqa: PLR0913 - the team, the robot and what a test sets
        self,
        team: Team,
        me: Robot,
        *,
        announces: bool,
        wanted: Collection[str],
        wake: Callable[[], None],
        confirm_s: float = CONFIRM_S,
    ) -> None:
        with needs_extra("a robot without an address in the team file", "mdns"):
            import zeroconf  # noqa: F401, PLC0415 - an extra; loads for 0.3 s
        self._team = team
        self._me = me
        self._announces = announces
        self._wanted = frozenset(wanted)
        self._wake = wake
        self._confirm_s = confirm_s
        self._lock = threading.Lock()
        # By robot and announcement, the newest last: addresses.
        self._found: dict[str, dict[str, tuple[str, ...]]] = {name: {} for name in self._wanted}
        self._unconfirmed: set[str] = set()  # announcements not seen again in this session
        self._requests: set[asyncio.Task[None]] = set()
        self._guard = Guard(f"{me.name}: an error in mDNS")
        self._own: list[str] = []  # addresses of this machine in this session
        self._loop: asyncio.AbstractEventLoop | None = None  # while the thread runs
        self._restart: asyncio.Event | None = None
        self._closed = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name=f"mocha-link mdns {me.name}", daemon=True
        )

    @classmethod
    def needed(
        cls, team: Team, me: Robot, *, announces: bool, wake: Callable[[], None]
    ) -> Mdns | None:
        """For a robot without an address, or with such peers; None: all have one.

        Raises:
            MissingExtraError: zeroconf is not installed.
        """
        wanted = [peer for peer in me.peers if team.robot(peer).address is None]
        announces = announces and me.address is None
        if not wanted and not announces:
            return None
        return cls(team, me, announces=announces, wanted=wanted, wake=wake)

    def start(self) -> None:
        """Begin; returns at once."""
        self._thread.start()

    def close(self) -> None:
        """Announce the end, and stop within `MDNS_CLOSE_S`, or a little later on its own."""
        self._closed.set()
        self._begin_anew()
        if self._thread.ident is not None:
            self._thread.join(MDNS_CLOSE_S)

    def addresses_changed(self) -> None:
        """The addresses of this machine may have changed: announce the present ones.

        The kernel announces addresses whose lifetime is prolonged, too.
        """
        if _own_hosts() != self._own:
            self._begin_anew()

    def _begin_anew(self) -> None:
        with self._lock:
            loop, restart = self._loop, self._restart
        if loop and restart:
            with contextlib.suppress(RuntimeError):  # it has ended
                loop.call_soon_threadsafe(restart.set)

    def hosts(self, robot: str) -> tuple[str, ...]:
        """The addresses of a robot as announced, of the newest announcement first."""
        with self._lock:
            found = self._found.get(robot, {})
            each = [host for hosts in reversed(found.values()) for host in hosts]
        return tuple(dict.fromkeys(each))

    # --- on the thread

    def _run(self) -> None:
        with contextlib.suppress(asyncio.CancelledError):
            asyncio.run(self._serve())

    async def _serve(self) -> None:
        restart = asyncio.Event()
        with self._lock:
            self._loop, self._restart = asyncio.get_running_loop(), restart
        while not self._closed.is_set():
            restart.clear()
            errors = self._guard.errors
            with self._guard:
                await self._session(restart)
            if self._guard.errors > errors:  # no interface, or none that takes multicast
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(restart.wait(), AGAIN_S)
        with self._lock:
            self._loop = self._restart = None

    async def _session(self, restart: asyncio.Event) -> None:
        """Announce and listen until the addresses change, or the node ends."""
        from zeroconf import InterfaceChoice, IPVersion  # noqa: PLC0415 - an extra
        from zeroconf.asyncio import AsyncServiceBrowser, AsyncZeroconf  # noqa: PLC0415

        # The browser of this session reports the end of what it has seen itself, no other.
        self._unconfirmed = {name for found in self._found.values() for name in found}
        self._own = _own_hosts()
        listen = self._me.listen
        single = listen != ANY and is_number(listen)
        version = IPVersion.All
        if single:
            version = IPVersion.V6Only if ":" in listen else IPVersion.V4Only
        daemon = AsyncZeroconf(
            interfaces=[listen] if single else InterfaceChoice.All, ip_version=version
        )
        try:
            if self._wanted:
                AsyncServiceBrowser(daemon.zeroconf, SERVICE, handlers=[self._changed])
            hosts = [listen] if single else self._own
            if self._announces and hosts:
                await daemon.async_register_service(self._announcement(hosts))
            if not self._closed.is_set():
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(restart.wait(), self._confirm_s)
                if not restart.is_set():
                    for name in self._unconfirmed:
                        self._forget(name)
                await restart.wait()
        finally:
            for request in list(self._requests):
                request.cancel()
            await daemon.async_close()  # with a farewell

    def _announcement(self, hosts: Sequence[str]) -> Any:
        from zeroconf import ServiceInfo  # noqa: PLC0415 - an extra

        label = f"mocha-{os.urandom(6).hex()}"
        return ServiceInfo(
            SERVICE,
            f"{label}.{SERVICE}",
            addresses=[_packed(host) for host in hosts],
            port=self._me.base_port,
            properties={"robot": self._me.name, "key": self._me.key or ""},
            server=f"{label}.local.",
        )

    def _changed(self, zeroconf: Any, service_type: str, name: str, state_change: Any) -> None:
        from zeroconf import ServiceStateChange  # noqa: PLC0415 - an extra

        self._unconfirmed.discard(name)
        if state_change is ServiceStateChange.Removed:
            self._forget(name)
        elif len(self._requests) < _MAX_REQUESTS:
            request = asyncio.get_running_loop().create_task(
                self._complete(zeroconf, service_type, name)
            )
            self._requests.add(request)
            request.add_done_callback(self._requests.discard)

    async def _complete(self, zeroconf: Any, service_type: str, name: str) -> None:
        """Request what an announcement lacks, and take it."""
        from zeroconf.asyncio import AsyncServiceInfo  # noqa: PLC0415 - an extra

        with self._guard:  # anyone can announce anything
            info = AsyncServiceInfo(service_type, name)
            if info.load_from_cache(zeroconf) or await info.async_request(zeroconf, REQUEST_MS):
                self._take(name, info)

    def _take(self, name: str, info: Any) -> None:
        """Note the addresses of an announcement, if it is of a robot that is to be found.

        A port or a key that is not in our team file is of another team.
        """
        robot = (info.decoded_properties.get("robot") or "")[:64]
        if robot not in self._wanted:
            return
        known = self._team.robot(robot)
        key = info.decoded_properties.get("key") or None
        if info.port != known.base_port or key != known.key:
            return
        hosts = tuple(filter(None, map(_usable, info.parsed_scoped_addresses())))[:MAX_OF_NAME]
        with self._lock:
            found = self._found[robot]
            before = found.pop(name, ())
            if hosts:
                found[name] = hosts
            while len(found) > MAX_ANNOUNCEMENTS:
                del found[next(iter(found))]
        if hosts != before:
            self._wake()

    def _forget(self, name: str) -> None:
        with self._lock:
            gone = [found.pop(name, None) for found in self._found.values()]
        if any(gone):
            self._wake()


def _own_hosts() -> list[str]:
    """The addresses of this machine, IPv4 first; loopback only if there is no other."""
    import ifaddr  # noqa: PLC0415 - zeroconf brings it

    texts = [
        each.ip if isinstance(each.ip, str) else each.ip[0]
        for adapter in ifaddr.get_adapters()
        for each in adapter.ips
    ]
    hosts = [host for host in texts if not ipaddress.ip_address(host).is_loopback] or texts
    return sorted(hosts, key=lambda host: (":" in host, ipaddress.ip_address(host).is_link_local))


def _packed(host: str) -> bytes:
    return ipaddress.ip_address(host.partition("%")[0]).packed


def _usable(text: str) -> str | None:
    """An announced address as a host; None: no machine can have it."""
    host, _, zone = text.partition("%")
    try:
        number = ipaddress.ip_address(host)
        if number.is_multicast or number.is_unspecified or number.is_reserved:
            return None
        if zone.isdecimal():
            zone = socket.if_indextoname(int(zone))
        return as_host(f"{host}%{zone}" if zone else host)
    except (ValueError, OSError):
        return None
