"""Whole nodes without sockets, and a model of what is between them: TCP, UDP, time, cuts.

Below the tests, which fly the same network, and the fleets that are measured in it.
"""

import heapq
import itertools
import pathlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from mocha_link.clock import Instant
from mocha_link.node import Gossip
from mocha_link.store import Header, wire
from mocha_link.sync import (
    DIALLED,
    Action,
    Connect,
    Disconnect,
    Reply,
    ReplyDatagram,
    Send,
    SendDatagram,
)
from mocha_link.team import Document, Team

T = 1_795_175_900.0
NAMES = ("callisto", "io", "titan")
STEADY_S = 1000.0
TICK_S = 0.25
LIMIT_S = 120.0
BUSY = 20
NEAR_DBM = -50.0
TURN_S = 0.01  # of a meeting; a few of them outlast `pull.NEAR_CONNECT_S`
QUIET_TURNS = 4

Path = Literal["zmq", "udp"]


def team_of(text: str) -> Team:
    """The team of a team file's text."""
    return Team.from_document(Document.from_text(text, pathlib.Path("team.yaml")))


def pulling(node: Any) -> list[str]:
    """The peers from which a pull is under way."""
    return [link.peer.name for link in node._links if link.session.pulls]  # noqa: SLF001 - whole nodes


def pair_of(topics: int) -> Team:
    """io and titan, with so many topics each, `/t0` and so on."""
    listed = ", ".join(f"{{name: /t{topic}, type: a/B}}" for topic in range(topics))
    text = f"""\
robots:
  io: {{kind: rover, address: a, base_port: 10, clients: [titan]}}
  titan: {{kind: rover, address: b, base_port: 10, clients: [io]}}
kinds:
  rover: {{topics: [{listed}]}}
"""
    return team_of(text)


class Carried(NamedTuple):
    """What was given to the network: a frame of a connection or a datagram."""

    path: Path
    source: str
    target: str
    data: bytes


@dataclass
class Line:
    """A connection; it stands after a round trip, and is dead once something of it was lost."""

    number: int
    client: str
    server: str
    stands_s: float
    dead: bool = False
    waiting: list[bytes] = field(default_factory=list)

    @property
    def route(self) -> tuple[bytes, ...]:
        return (self.number.to_bytes(4), b"")


class NetworkSim:
    """Carries what nodes send, each piece `delay_s` after it left, in order.

    `blocked` has (path, source, target) of what is lost without an error; of `left` more pieces all
    are carried, then none (None: no limit). `silent` names who is not there at all;
    `lets_by` decides of each piece whether it gets there, `alter` what gets there of it.
    """

    def __init__(
        self,
        team: Team,
        *,
        names: Iterable[str] = NAMES,
        delay_s: float = 0.0,
        datagrams: bool = False,
        by_timer: bool = False,
    ) -> None:
        self._ids = itertools.count(1)
        self._order = itertools.count()
        self._lines = itertools.count(1)
        self.team = team
        self.delay_s = delay_s
        self.time_s = 0.0
        self.offset_s: dict[str, float] = {}  # how wrong clocks are
        self.options = {"by_timer": by_timer, "datagrams": datagrams}
        self.nodes: dict[str, Any] = {}
        self.events: dict[str, list[object]] = {name: [] for name in names}
        self.refused: dict[str, list[str]] = {name: [] for name in names}
        self.blocked: set[tuple[Path, str, str]] = set()
        self.unreached: set[tuple[str, str]] = set()  # client, server: nothing opens in between
        self.silent: set[str] = set()
        self.lets_by: Callable[[Carried], bool] | None = None
        self.alter: Callable[[Carried], bytes] = lambda piece: piece.data
        self.left: int | None = None
        self.carried: list[Carried] = []
        self._busy = 0
        self.lines: dict[tuple[str, str], Line] = {}
        self._served: dict[tuple[str, bytes], Line] = {}
        self._callers: set[tuple[str, str]] = set()  # server, client: it knows where to cast back
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        for name in names:
            self.restart(name)

    @property
    def now(self) -> Instant:
        return Instant(T + self.time_s, STEADY_S + self.time_s)

    def at(self, name: str) -> Instant:
        """Now, by the clocks of a node."""
        return Instant(self.now.unix_s + self.offset_s.get(name, 0.0), self.now.steady_s)

    def restart(self, name: str, **options: object) -> None:
        """A new process; nothing of the old one is left."""
        options = {**self.options, **options}
        node = Gossip(self.team, name, new_id=lambda: next(self._ids).to_bytes(6), **options)
        self.become(name, node)

    def become(self, name: str, node: Any) -> None:
        """Another node takes the place of a robot; connections of the old one are gone."""
        self.nodes[name] = node
        for client, server in [key for key in self.lines if name in key]:
            del self.lines[client, server]
            if client != name:
                self.nodes[client].lost(server, "the peer closed the connection", self.at(client))
        self._callers = {pair for pair in self._callers if pair[0] != name}

    def publish(self, name: str, topic: str, data: bytes) -> Header:
        return self.nodes[name].publish(self.team.topic(name, topic), data, self.at(name))

    def pull(self, client: str, server: str, *, cut_after: int | None = None) -> None:
        """One pull, until nothing more happens by itself; after `cut_after` pieces all is lost."""
        self.left = cut_after
        self.nodes[client].sync(server, self.at(client))
        if cut_after is None:
            self.settle()
        else:
            self.carry()
        self.left = None

    def meet(self, a: str, b: str, *, cut: int | None = None) -> None:
        """Two come near, out of reach of all others; both pull until all is sent, or is cut.

        cut: so many pieces are carried, no more.
        """
        self.lets_by = lambda piece: {piece.source, piece.target} == {a, b}
        self.left = cut
        for name, peer in ((a, b), (b, a)):
            self.nodes[name].signal_received(peer, NEAR_DBM, self.at(name))
        quiet = 0
        while quiet < QUIET_TURNS and self.left != 0:
            before = len(self.carried)
            self.wait(TURN_S)
            quiet = 0 if len(self.carried) > before else quiet + 1
        self.left = 0
        for name, peer in ((a, b), (b, a)):
            self.nodes[name].signal_received(peer, None, self.at(name))
            self.nodes[name].lost(peer, "out of reach", self.at(name))
        self.carry()

    def part(self, seconds: float) -> None:
        """Time passes at once; no robot is in reach of another."""
        self.left = 0
        self.time_s += seconds
        for name, node in self.nodes.items():
            node.tick(self.at(name))
        self.carry()

    def carry(self) -> None:
        """Everything that happens without time passing but for the way."""
        self._act()
        while self._due:
            self._step()

    def settle(self) -> None:
        """Let time pass until no pull is under way any more."""
        until_s = self.time_s + LIMIT_S
        self._act()
        while any(map(pulling, self.nodes.values())) or self._due:
            if self.time_s >= until_s:
                raise RuntimeError("a pull that does not end")
            self._advance(until_s)
        self._act()

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        until_s = self.time_s + seconds
        self._act()
        while self.time_s < until_s:
            self._advance(until_s)

    def held(self, name: str) -> dict[tuple[str, str], bytes]:
        """The newest message of every topic that a node holds."""
        held = {}
        for record in self.nodes[name].database.records():
            robot, topic = self.team.by_ids(record.header.robot_id, record.header.topic_id)
            held[robot.name, topic.name] = wire.unpack(record.body)
        return held

    def links(self, name: str) -> Any:
        """What a node knows of each of its peers."""
        return self.nodes[name]._links  # noqa: SLF001 - whole nodes

    def link(self, name: str, peer: str) -> Any:
        """What a node knows of a peer, and the parts that talk with it."""
        return self.links(name).by_peer[peer]

    def events_of(self, name: str, kind: type) -> list:
        """The events of a kind that a node reported."""
        return [event for event in self.events[name] if isinstance(event, kind)]

    def sent(self, path: Path, source: str, target: str) -> list[bytes]:
        """What one gave to the network for another."""
        return [c.data for c in self.carried if c[:3] == (path, source, target)]

    # --- how it works

    def _advance(self, until_s: float) -> None:
        """Go on to whatever is next."""
        if self._due and self._due[0][0] <= self.time_s:
            self._step()
            return
        wakes = [node.wake_s for node in self.nodes.values()]
        times = [wake_s - STEADY_S for wake_s in wakes if wake_s is not None]
        times += [due[0] for due in self._due[:1]]
        times += [self.time_s + TICK_S, until_s]
        before_s = self.time_s
        self.time_s = max(min(times), before_s)
        self._busy = self._busy + 1 if self.time_s == before_s else 0
        if self._busy >= BUSY:
            raise RuntimeError("a node that wants to be woken again and again does nothing")
        if self._busy:
            self.time_s += 1e-4
        if self._due and self._due[0][0] <= self.time_s:
            self._step()
        for name, node in self.nodes.items():
            node.tick(self.at(name))
        self._act()

    def _step(self) -> None:
        due_s, _, arrive = heapq.heappop(self._due)
        self.time_s = max(self.time_s, due_s)
        arrive()
        self._act()

    def later(self, arrive: Callable[[], None], at_s: float | None = None) -> None:
        when_s = self.time_s + self.delay_s if at_s is None else at_s
        heapq.heappush(self._due, (when_s, next(self._order), arrive))

    def _act(self) -> None:
        """Carry what the nodes want carried, until none wants anything more."""
        busy = True
        while busy:
            busy = False
            for name, node in self.nodes.items():
                actions, events = node.take()
                self.events[name] += events
                for action in actions:
                    busy = True
                    self._do(name, action)
                for peer in node.me.peers:
                    supplied = node.supply(peer)
                    if supplied:
                        busy = True
                        route, parts = supplied
                        self._reply_on(name, peer, route, b"".join(parts))

    def _do(self, name: str, action: Action) -> None:
        peer = action.peer
        match action:
            case Connect():
                self.dial(name, peer)
            case Send():
                self._send(name, peer, action.frame)
            case Disconnect():
                self.lines.pop((name, peer), None)
            case Reply():
                self._reply_on(name, peer, action.route, action.frame)
            case SendDatagram():
                piece = Carried("udp", name, peer, action.packet)
                if (name, peer) not in self.unreached and self._lets(piece):
                    self.later(lambda: self._cast(name, peer, self.alter(piece)))
            case ReplyDatagram():
                piece = Carried("udp", name, peer, action.packet)
                if (name, peer) in self._callers and self._lets(piece):
                    back = self.nodes[peer].packet_back
                    self.later(lambda: back(name, self.alter(piece), self.at(peer)))

    def _send(self, client: str, server: str, frame: bytes) -> None:
        line = self.lines.get((client, server))
        if line:
            line.waiting.append(frame)
            if self.time_s >= line.stands_s:
                self._flush(line)

    def _reply_on(self, name: str, peer: str, route: tuple[bytes, ...], frame: bytes) -> None:
        if route == DIALLED:
            self._send(name, peer, frame)
        else:
            self._answer(name, route, frame)

    def dial(self, client: str, server: str) -> Line:
        """A connection of one robot to another, in place of any that there was."""
        stands_s = self.time_s + 2 * self.delay_s
        line = Line(next(self._lines), client, server, stands_s)
        self.lines[client, server] = line
        self._served[server, line.route[0]] = line
        self.later(lambda: self._stand(line), stands_s)
        return line

    def _lets(self, piece: Carried) -> bool:
        self.carried.append(piece)
        if piece[:3] in self.blocked or self.silent & {piece.source, piece.target}:
            return False
        if self.lets_by and not self.lets_by(piece):
            return False
        if self.left is None:
            return True
        self.left = max(self.left - 1, -1)
        return self.left >= 0

    def _stand(self, line: Line) -> None:
        if self.lines.get((line.client, line.server)) is not line or line.dead:
            return
        way = ("zmq", line.client, line.server)
        unreached = (line.client, line.server) in self.unreached
        if (
            unreached
            or way in self.blocked
            or self.silent & {line.client, line.server}
            or self.left == 0
        ):
            line.dead = True
            return
        self.nodes[line.client].progress(line.server, self.at(line.client))
        self._flush(line)

    def _flush(self, line: Line) -> None:
        for frame in line.waiting:
            piece = Carried("zmq", line.client, line.server, frame)
            if not line.dead and self._lets(piece):
                self.later(lambda p=piece: self._request(line, self.alter(p)))
            else:
                line.dead = True
        line.waiting.clear()

    def _request(self, line: Line, frame: bytes) -> None:
        self.nodes[line.server].request(line.client, line.route, [frame], self.at(line.server))

    def _answer(self, server: str, route: tuple[bytes, ...], frame: bytes) -> None:
        line = self._served.get((server, route[0]))
        if line is None or line.dead:
            return
        piece = Carried("zmq", server, line.client, frame)
        if self._lets(piece):
            self.later(lambda: self._reply(line, self.alter(piece)))
        else:
            line.dead = True

    def _reply(self, line: Line, frame: bytes) -> None:
        if self.lines.get((line.client, line.server)) is line:
            self.nodes[line.client].reply(line.server, [frame], self.at(line.client))

    def _cast(self, client: str, server: str, packet: bytes) -> None:
        if self.nodes[server].packet_in(client, packet, self.at(server)):
            self._callers.add((server, client))
