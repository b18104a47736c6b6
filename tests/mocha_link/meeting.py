"""Engines that meet without sockets: several nodes in one process, each with its own clock.

What is sent arrives at once and in order, until the contact is cut. A place in the team may be
taken by a stand-in for an original node (`original.py`), which then answers and asks without
sockets, too.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

from mocha_link.clock import Instant
from mocha_link.node.actions import Connect, Disconnect, Reply, ReplyDatagram, Send, SendDatagram
from mocha_link.node.gossip import Gossip
from tests.mocha_link import original

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mocha_link.links.link_events import LinkEvent
    from mocha_link.node.actions import Action
    from mocha_link.team.team import Team

NEAR_DBM = -50.0
STEP_S = 0.01  # a turn of all in a contact; a few of them outlast `pull.LOOK_S`
QUIET_TURNS = 4


class Member:
    """A place in the team: who is there now, and how far its clock is from the true time."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.node: Gossip | PureOriginal | None = None
        self.ahead_s = 0.0
        self.events: list[LinkEvent] = []

    @property
    def engine(self) -> Gossip:
        assert isinstance(self.node, Gossip)
        return self.node


class PureOriginal(original.Original):
    """The stand-in, asking over a `Meeting` instead of sockets."""

    def __init__(self, team: Team, name: str, meeting: Meeting) -> None:
        self._meeting = meeting
        super().__init__(team, name, now_s=lambda: meeting.now(name).unix_s)
        self._context.term()

    def ask(self, peer: str, request: bytes, timeout_s: float | None = None) -> bytes | None:
        return self._meeting.ask(self.robot.name, peer, request)

    def answer(self, peer: str, frame: bytes) -> bytes | None:
        """The whole reply to a request frame; None: the peer's port is dead, or all are."""
        if self._dies_of([frame]):
            self.dead.add(peer)
        if peer in self.dead:
            return None
        body = self._answer(frame[original.ID :])
        return None if self.stopped else frame[: original.ID] + body


class Meeting:
    """The team, the true time, and what is between its robots."""

    def __init__(self, team: Team, now_s: float) -> None:
        self.team = team
        self.time_s = now_s
        self.frames = 0  # that arrived anywhere
        self.members = {name: Member(name) for name in team.robots}
        self._steady_s = 0.0
        self._contact: frozenset[str] = frozenset()
        self._left: int | None = None  # frames until the cut
        self._connections: dict[tuple[str, str], int] = {}
        self._dialled = 0

    def events(self, name: str) -> list[LinkEvent]:
        """What the engines of a robot have told, in all their lives."""
        return self.members[name].events

    def now(self, name: str) -> Instant:
        """The present by the clock of a robot."""
        return Instant(self.time_s + self.members[name].ahead_s, self._steady_s)

    def wait(self, seconds: float) -> None:
        """Time passes; everybody is out of reach."""
        self.time_s += seconds
        self._steady_s += seconds
        for name, node in self._engines():
            node.tick(self.now(name))
        self._deliver()

    def meet(self, a: str, b: str, *, cut: int | None = None) -> None:
        """Two robots come into contact; both pull, until all is said or the contact is cut.

        cut: so many frames arrive, no more.
        """
        self._contact, self._left = frozenset((a, b)), cut
        for name, peer in ((a, b), (b, a)):
            node = self.members[name].node
            if isinstance(node, Gossip):
                node.heard(peer, NEAR_DBM, self.now(name))
            else:
                self._deliver()
                node.pull(peer)
        quiet = 0
        while quiet < QUIET_TURNS and self._left != 0:
            quiet = 0 if self._deliver() else quiet + 1
            self.time_s += STEP_S
            self._steady_s += STEP_S
            for name in (a, b):
                if isinstance(self.members[name].node, Gossip):
                    self.members[name].engine.tick(self.now(name))
        self._contact = frozenset()
        for name, peer in ((a, b), (b, a)):
            if isinstance(self.members[name].node, Gossip):
                self.members[name].engine.heard(peer, None, self.now(name))
                self.members[name].engine.lost(peer, "out of reach", self.now(name))
        self._deliver()

    def ask(self, name: str, peer: str, request: bytes) -> bytes | None:
        """One request of an original node, and what comes back of the reply."""
        request_id = self._dialled.to_bytes(original.ID)
        self._dialled += 1
        node = self.members[peer].engine
        if not self._arrives(name, peer):
            return None
        node.request(name, (request_id,), [request_id + request], self.now(peer))
        replies = []
        for action in self._take(peer):
            if isinstance(action, Reply) and action.route == (request_id,):
                replies.append(action.frame)
            else:
                self._do(peer, action)
        if not replies or not self._arrives(name, peer):
            return None
        (reply,) = replies
        assert reply[: original.ID] == request_id
        return reply[original.ID :]

    def _engines(self) -> Iterator[tuple[str, Gossip]]:
        for name, member in self.members.items():
            if isinstance(member.node, Gossip):
                yield name, member.node

    def _arrives(self, a: str, b: str) -> bool:
        """Whether the next frame between two robots does; it counts."""
        if self._contact != {a, b} or self._left == 0:
            return False
        if self._left is not None:
            self._left -= 1
        self.frames += 1
        return True

    def _deliver(self) -> bool:
        """Carry all that there is to carry; whether there was anything."""
        moved = again = False
        while again or not moved:
            again = False
            for name, _ in self._engines():
                for action in self._take(name):
                    self._do(name, action)
                    again = True
            for name, peer in itertools.permutations(sorted(self._contact), 2):
                node = self.members[name].node
                again |= isinstance(node, Gossip) and self._supply(name, node, peer)
            if not again:
                return moved
            moved = True
        return moved

    def _take(self, name: str) -> list[Action]:
        member = self.members[name]
        actions, events = member.engine.take()
        member.events += events
        return actions

    def _supply(self, name: str, node: Gossip, peer: str) -> bool:
        supplied = node.supply(peer)
        if supplied is None:
            return False
        route, parts = supplied
        self._give_back(name, peer, route, b"".join(parts))
        return True

    def _give_back(self, name: str, peer: str, route: tuple[bytes, ...], frame: bytes) -> None:
        """What a server says, to the one that asked on that connection, if it is still there."""
        there = self._connections.get((peer, name)) == int.from_bytes(route[0])
        asker = self.members[peer].node
        if isinstance(asker, Gossip) and self._arrives(name, peer) and there:
            asker.reply(name, [frame], self.now(peer))

    def _do(self, name: str, action: Action) -> None:
        peer = action.peer
        node = self.members[peer].node
        match action:
            case Connect():
                self._dialled += 1
                self._connections[name, peer] = self._dialled
            case Disconnect():
                self._connections.pop((name, peer), None)
            case Send():
                if self._arrives(name, peer):
                    self._ask_engine_or_original(name, peer, action.frame)
            case Reply():
                self._give_back(name, peer, action.route, action.frame)
            case SendDatagram():
                if isinstance(node, Gossip) and self._arrives(name, peer):
                    node.packet_in(name, action.packet, self.now(peer))
            case ReplyDatagram():
                if isinstance(node, Gossip) and self._arrives(name, peer):
                    node.packet_back(name, action.packet, self.now(peer))

    def _ask_engine_or_original(self, name: str, peer: str, frame: bytes) -> None:
        node = self.members[peer].node
        connection = self._connections.get((name, peer))
        if connection is None:
            return
        route = (connection.to_bytes(8),)
        if isinstance(node, Gossip):
            node.request(name, route, [frame], self.now(peer))
        elif node:
            reply = node.answer(name, frame)
            if reply is not None and self._arrives(name, peer):
                self.members[name].engine.reply(peer, [reply], self.now(name))
