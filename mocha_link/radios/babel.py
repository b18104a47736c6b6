"""Links of a Babel network, from babeld's local socket: neighbours, and peers behind relays.

babeld (RFC 8966) measures the links to its neighbours by Hello and IHU packets, and computes routes
with a metric. A program that connects to its socket (`local-port` or `local-path`) and sends
``monitor`` gets every neighbour and route as a line, and a line for each change:

    add neighbour 5d address fe80::1 if wlan0 reach ffff ureach 0000 rxcost 256 txcost 258 cost 258
    change route 5e prefix 10.9.0.2/32 from 0.0.0.0/0 installed yes id 0c:e0 metric 552 refmetric
        294 via fe80::1 if wlan0                                                 (this is one line)

A peer is identified by an address that babeld has a host route to (the peer's `address` or
`radio_id`), or as a neighbour by the MAC or link-local address in its `radio_id`.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import re
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

from mocha_link.errors import RadioError
from mocha_link.links import Reading, Unit
from mocha_link.logs import Log, NodeLog
from mocha_link.radios.peers import peers_by_radio
from mocha_link.radios.radio import LOG, BackgroundRadio, Report
from mocha_link.team import RadioUrl, Robot, Team

POLL_S = 1.0  # so often all readings are reported
PROBE_S = 5.0  # so often babeld is requested to list all again, which shows that it lives
SILENT_S = 15.0  # without its answer it hangs, or the connection is dead
RETRY_S = 2.0
CONNECT_S = 5.0
MAX_LINE_BYTES = 1024  # babeld's longest are 250
MAX_ENTRIES = 4096  # of neighbours, and of routes

_HOST = "::1"  # where babeld listens; a name may stand for 127.0.0.1 only
PERFECT_COST = 256  # of a wireless link without loss, as babeld has it
UNREACHABLE = 65535

_Entry = TypeVar("_Entry")
_KINDS = ("neighbour", "route")
_VERBS = ("add", "change", "flush")
_COUNT = re.compile(r"\d{1,9}", re.ASCII)
_REACH = re.compile(r"[0-9a-f]{4}")
_RTT_MS = re.compile(r"\d{1,9}(\.\d{1,9})?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A router that babeld receives Hello packets from.

    Attributes:
        address: its link-local address.
        interface: the interface to it.
        hellos: how many of the last 16 Hello packets came (multicast or unicast, the better).
        rxcost: cost of receiving from it; 256 is a wireless link without loss.
        txcost: cost of sending to it, as it reports.
        rtt_s: round trip; None: not measured on this interface.
        cost: of the link, which counts in metrics; 65535: unreachable.
    """

    address: str
    interface: str
    hellos: int
    rxcost: int
    txcost: int
    rtt_s: float | None
    cost: int


@dataclass(frozen=True, slots=True)
class Route:
    """A route to one address.

    Attributes:
        address: where it leads.
        installed: whether the kernel uses it.
        metric: the sum of the costs on the way; 65535: unreachable.
        via: the link-local address of the neighbour that it goes by.
    """

    address: str
    installed: bool
    metric: int
    via: str


class BabelTable:
    """What babeld has reported since the connection began.

    Attributes:
        neighbours: by babeld's ids.
        routes: those to single addresses, by babeld's ids.
    """

    def __init__(self) -> None:
        self.neighbours: dict[str, Neighbour] = {}
        self.routes: dict[str, Route] = {}

    def feed(self, line: str) -> None:
        """Take in a line; other lines than those of neighbours and routes are left out.

        Raises:
            RadioError: a line of a neighbour or route that has no such form.
        """
        verb, _, rest = line.partition(" ")
        kind, _, rest = rest.partition(" ")
        if verb not in _VERBS or kind not in _KINDS:
            return
        name, *words = rest.split()[: MAX_LINE_BYTES // 2] or [""]
        if verb == "flush":
            self.neighbours.pop(name, None) if kind == "neighbour" else self.routes.pop(name, None)
            return
        fields = dict(zip(words[::2], words[1::2], strict=False))
        try:
            if kind == "neighbour":
                _keep(self.neighbours, name, _neighbour(fields))
            else:
                _keep(self.routes, name, _route(fields))
        except (KeyError, ValueError):
            raise RadioError(f"babeld's line is not understood: {line[:100]!r}") from None

    def readings(self) -> dict[str, Reading]:
        """The links that carry data, by MAC or IP address of the other end."""
        costs: dict[str, int] = {}
        for each in self.neighbours.values():
            if each.hellos:
                for name in filter(None, (each.address, _mac_of(each.address))):
                    costs[name] = min(each.cost, costs.get(name, UNREACHABLE))
        for route in self.routes.values():
            if route.installed:
                costs[route.address] = min(route.metric, costs.get(route.address, UNREACHABLE))
        return {name: quality(cost) for name, cost in costs.items() if cost < UNREACHABLE}


def quality(cost: int) -> Reading:
    """A cost or metric as a reading: 100 per transmission that a packet takes; more is better."""
    percent = 100.0 * PERFECT_COST / max(cost, PERFECT_COST)
    return Reading(round(percent, 1), Unit.DEVICE, "babel")


def _keep(table: dict[str, _Entry], name: str, value: _Entry | None) -> None:
    if value is None:
        table.pop(name, None)
    elif name in table or len(table) < MAX_ENTRIES:
        table[name] = value


def _neighbour(fields: Mapping[str, str]) -> Neighbour:
    reach = [fields["reach"], fields.get("ureach", "0000")]
    if not all(map(_REACH.fullmatch, reach)):
        raise ValueError("reach")
    rtt = fields.get("rtt")
    if rtt is not None and not _RTT_MS.fullmatch(rtt):
        raise ValueError("rtt")
    return Neighbour(
        address=str(ipaddress.ip_address(fields["address"])),
        interface=fields["if"],
        hellos=max(int(each, 16).bit_count() for each in reach),
        rxcost=_count(fields["rxcost"]),
        txcost=_count(fields["txcost"]),
        rtt_s=None if rtt is None else float(rtt) / 1000,
        cost=_count(fields["cost"]),
    )


def _route(fields: Mapping[str, str]) -> Route | None:
    """The route, if it leads to one address, from anywhere."""
    prefix = ipaddress.ip_network(fields["prefix"])
    source = ipaddress.ip_network(fields["from"])
    if prefix.num_addresses > 1 or source.prefixlen:
        return None
    return Route(
        address=str(prefix.network_address),
        installed=fields["installed"] == "yes",
        metric=_count(fields["metric"]),
        via=str(ipaddress.ip_address(fields["via"])),
    )


def _count(text: str) -> int:
    if not _COUNT.fullmatch(text):
        raise ValueError(text)
    return int(text)


def _mac_of(address: str) -> str | None:
    """The MAC address that a link-local address was made of (EUI-64), if it was."""
    found = ipaddress.ip_address(address)
    if not (isinstance(found, ipaddress.IPv6Address) and found.is_link_local):
        return None
    raw = found.packed[8:]
    if raw[3:5] != b"\xff\xfe":
        return None
    return bytes((raw[0] ^ 2, *raw[1:3], *raw[5:])).hex(":")


class BabelRadio(BackgroundRadio):
    """Reports the links of a babeld (``babel://localhost:33123`` or ``babel:/run/babeld.sock``).

    babeld may start later, and restart; while it cannot be reached no peer has a signal.

    Args:
        url: one of these.
        peers: the robots by MAC or IP address, in lower case.
        poll_s: so often all is reported, in real seconds.
        probe_s: real seconds between requests to babeld that it list all again.
        silent_s: without its answer for so long the connection begins anew.
        retry_s: real seconds before the next attempt to connect.
        log: where it logs.
    """

    def __init__(  # noqa: PLR0913 - its intervals
        self,
        url: RadioUrl,
        peers: Mapping[str, str],
        *,
        poll_s: float = POLL_S,
        probe_s: float = PROBE_S,
        silent_s: float = SILENT_S,
        retry_s: float = RETRY_S,
        log: Log = LOG,
    ) -> None:
        super().__init__(log)
        self._url = url
        self._peers = peers
        self._poll_s = poll_s
        self._probe_s = probe_s
        self._silent_s = silent_s
        self._retry_s = retry_s
        self._reported: dict[str, Reading] = {}  # last, by MAC or IP address

    def start(self, report: Report) -> None:
        """Begin to listen; babeld may come up later."""
        self._begin(report, self._listen())

    async def _listen(self) -> None:
        complaint = ""
        while True:
            table, why = BabelTable(), "it closed the connection"
            try:
                async with self._connection() as (stream, babeld):
                    await self._follow(table, stream, babeld)
            except (OSError, RadioError) as error:  # TimeoutError is one
                why = str(error) or "no answer"
            if why != complaint or table.neighbours:  # once, not every two seconds
                self.log.warning("%s: %s; trying again", self._url, why)
            complaint = why
            self._report_links(BabelTable())
            await asyncio.sleep(self._retry_s)

    async def _follow(
        self, table: BabelTable, stream: asyncio.StreamReader, babeld: asyncio.StreamWriter
    ) -> None:
        """Report until the connection ends. Raises RadioError or OSError."""
        babeld.write(b"monitor\n")
        loop = asyncio.get_running_loop()
        repeating = loop.create_task(self._repeat(table, babeld))
        try:
            async with asyncio.timeout(self._silent_s) as silence:
                first = True
                async for line in self.lines(stream):
                    text = line.decode(errors="replace").strip()
                    if first and not text.startswith("BABEL "):
                        raise RadioError("what serves there is not babeld")
                    first = False
                    if text.partition(" ")[0] in ("bad", "no"):
                        raise RadioError(f"babeld refuses to be monitored ({text[:40]})")
                    if text == "ok":
                        silence.reschedule(loop.time() + self._silent_s)
                    try:
                        table.feed(text)
                    except RadioError as error:
                        self.refuse(error)
        finally:
            repeating.cancel()
            await asyncio.wait((repeating,))  # `await repeating` would hide that we are cancelled
            if not repeating.cancelled():
                repeating.result()

    async def _repeat(self, table: BabelTable, babeld: asyncio.StreamWriter) -> None:
        """Report what the table has, and have babeld list it again now and then."""
        due_s, loop = 0.0, asyncio.get_running_loop()
        while True:
            await asyncio.sleep(self._poll_s)
            self._report_links(table)
            if loop.time() >= due_s:
                due_s = loop.time() + self._probe_s
                babeld.write(b"dump\n")

    def _report_links(self, table: BabelTable) -> None:
        readings = table.readings()
        self.pass_on_best({**dict.fromkeys(self._reported), **readings}, self._peers)
        self._reported = readings

    @contextlib.asynccontextmanager
    async def _connection(
        self,
    ) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
        """A connection to babeld. Raises OSError."""
        async with asyncio.timeout(CONNECT_S):
            if self._url.port is None:
                made = await asyncio.open_unix_connection(self._url.path, limit=MAX_LINE_BYTES)
            else:
                host = _HOST if self._url.host == "localhost" else self._url.host
                made = await asyncio.open_connection(host, self._url.port, limit=MAX_LINE_BYTES)
        with contextlib.closing(made[1]):
            yield made


def open_babel(url: RadioUrl, team: Team, robot: Robot) -> BabelRadio:
    """The radio ``babel:``. Raises RadioError."""
    return BabelRadio(url, peers_by_radio(team, robot, addresses=True), log=NodeLog(robot.name))
