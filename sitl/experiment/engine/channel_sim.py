"""What is on the air: exchanges between nodes wait for the channel, cross it, and are cut.

The nodes decide what they send; the channel's model decides who is in contact, whose turn it is,
and how long it takes. This carries it out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from mocha_link.links import Direction, MessageStored, SyncEnded, SyncTimedOut
from mocha_link.sync import CHUNKS, ID_BYTES, SYNC1, Action, Connect, Disconnect, Reply, Send
from sitl.experiment import EventQueue
from sitl.experiment.engine.channel import Change, Channel, Link, Load, Places, Stage
from sitl.experiment.engine.exchange import (
    AirtimeStats,
    ContactInterval,
    Exchange,
    code_of,
    finished_in,
    needs_turn,
    request_load,
    stage_of,
)
from sitl.experiment.engine.turns import Turns
from sitl.experiment.robots import Node


class ChannelSim:
    """Connects the nodes of a run, in the order of their numbers; `airtime` keeps count of it."""

    def __init__(
        self, queue: EventQueue, channel: Channel, nodes: Sequence[Node], airtime: AirtimeStats
    ) -> None:
        self._queue = queue
        self._channel = channel
        self._nodes = nodes
        self._numbers = {node.name: node.number for node in nodes}  # by name
        self._airtime = airtime
        self._contacts: dict[tuple[int, int], float] = {}  # since when
        self._exchanges: dict[Link, Exchange] = {}  # that are not over
        self._pulled_s: dict[Link, float] = {}  # when the last pull began
        self._turns = Turns()
        self._triggered = any(node.triggered for node in nodes)  # by their own pulls, not by ours
        self._busy: list[Link] = []  # whose exchanges are on the air
        self._count = 0  # of turns, partings and connections, which it tells apart
        self._replies: list[bytes] = []  # of the node that received the last request

    @property
    def open(self) -> int:
        """Pulls that are under way or wait."""
        return len(self._exchanges)

    def in_contact(self, a: int, b: int) -> bool:
        """Whether two robots, by their numbers, are in contact now."""
        return (min(a, b), max(a, b)) in self._contacts

    def contacts(self) -> list[ContactInterval]:
        """All contacts so far, in the order of their beginnings."""
        now_s = self._queue.now_s
        lasting = [
            ContactInterval(began_s, now_s, *pair) for pair, began_s in self._contacts.items()
        ]
        return sorted((*self._airtime.contacts, *lasting))

    def update(self, places: Places) -> None:
        """Robots have moved: contacts begin and end."""
        for change in self._channel.update(self._queue.now_s, places):
            if change.up:
                self._meet(change)
            else:
                self._part(change)
        if self._triggered:
            self.report()
            for node in self._nodes:
                node.gossip.tick(node.now)
                self._settle(node)
        elif self._channel.pull_every_s is not None:
            due_s = self._queue.now_s - self._channel.pull_every_s
            for a, b in self._contacts:
                for link in (Link(a, b), Link(b, a)):
                    if self._pulled_s[link] <= due_s and link not in self._exchanges:
                        self._pull(link)
        self._grant()

    def report(self) -> None:
        """Radios report again whom they receive."""
        for (a, b), began_s in self._contacts.items():
            self.report_contact(a, b, began_s, up=True)

    def _meet(self, change: Change) -> None:
        a, b, _ = change
        self._contacts[a, b] = self._queue.now_s
        self.report_contact(a, b, self._queue.now_s, up=True)
        for link in (Link(a, b), Link(b, a)):
            exchange = self._exchanges.get(link)
            if exchange is not None:
                exchange.again, exchange.parting = not self._triggered, 0
                self._arm(exchange)
            elif not self._triggered:
                self._pull(link)

    def _part(self, change: Change) -> None:
        a, b, _ = change
        began_s = self._contacts.pop((a, b))
        self._airtime.contacts.append(ContactInterval(began_s, self._queue.now_s, a, b))
        self.report_contact(a, b, began_s, up=False)
        for link in (Link(a, b), Link(b, a)):
            exchange = self._exchanges.get(link)
            if exchange is None:
                continue
            self._withdraw(exchange)
            exchange.again = False
            self._count += 1
            exchange.parting = self._count
            patience_s = self._channel.patience_s
            if patience_s == 0:
                self._lose(exchange, self._count)
            elif patience_s < math.inf:
                self._queue.after(patience_s, partial(self._lose, exchange, self._count))

    def report_contact(self, a: int, b: int, began_s: float, *, up: bool) -> None:
        """Two robots' radios are in contact, or no longer."""
        for node, peer in ((self._nodes[a], self._nodes[b]), (self._nodes[b], self._nodes[a])):
            if up and self._triggered:
                node.refresh()
            node.contact(peer.name, began_s, up=up)

    def _lose(self, exchange: Exchange, parting: int) -> None:
        """Patience is over, unless contact came back meanwhile."""
        if exchange.parting == parting and not exchange.over:
            node, peer = self._ends(exchange)
            node.gossip.lost(peer.name, "out of reach", node.now)
            self._settle(node)

    def _ends(self, exchange: Exchange) -> tuple[Node, Node]:
        """Who pulls, and from whom."""
        return self._nodes[exchange.link.requesting], self._nodes[exchange.link.answering]

    def _pull(self, link: Link) -> None:
        self._pulled_s[link] = self._queue.now_s
        node = self._nodes[link.requesting]
        node.refresh()  # its own messages belong to what it has
        node.gossip.sync(self._nodes[link.answering].name, node.now)
        self._settle(node)

    # Turns.

    def _arm(self, exchange: Exchange) -> None:
        """Have an exchange wait for the channel if it has something to send."""
        link = exchange.link
        if exchange.over or exchange.start_s is not None or not self.in_contact(*link):
            return
        while exchange.requests and not any(map(needs_turn, exchange.requests)):
            self._request(exchange, exchange.requests.popleft())
            if exchange.over:
                return
        if not (exchange.requests or exchange.load or self._supplies(exchange)):
            return
        if exchange.ready_s is None:
            exchange.ready_s = self._queue.now_s
        if exchange.turn is None:
            self._count += 1
            turn = self._channel.turn(link, exchange.ready_s)
            self._turns.add(exchange, (turn, self._count))

    def _supplies(self, exchange: Exchange) -> bool:
        """Whether the answering node may have frames for it."""
        requesting, answering = self._ends(exchange)
        return not exchange.dry and answering.gossip.route(requesting.name) == exchange.route

    def _withdraw(self, exchange: Exchange) -> None:
        """Contact is lost, or the exchange is over: off the air, and out of the queue."""
        self._turns.remove(exchange)
        if exchange.start_s is not None:
            now_s = self._queue.now_s
            part = (now_s - exchange.start_s) / max(exchange.end_s - exchange.start_s, 1e-9)
            self._airtime.sent(exchange, now_s, part)
            self._busy.remove(exchange.link)
            exchange.start_s = None

    def _grant(self) -> None:
        """Let those begin whose turn it is."""
        while self._turns:
            exchange = self._turns.first_beside(self._channel.occupied(self._busy))
            if exchange is None:
                return
            self._turns.remove(exchange)
            self._begin(exchange)

    def _begin(self, exchange: Exchange) -> None:
        if exchange.load is None:
            exchange.load = self._load(exchange)
        if exchange.load is None:  # nothing that takes time
            exchange.ready_s = None
            self._hand_over(exchange)
            self._arm(exchange)
            return
        now_s = self._queue.now_s
        took_s = self._channel.duration_s(exchange.link, exchange.load, now_s)
        exchange.start_s = now_s
        exchange.end_s = now_s + took_s
        self._busy.append(exchange.link)

        def end() -> None:
            if exchange.start_s == now_s:  # it was not cut meanwhile
                self._end(exchange)

        self._queue.at(exchange.end_s, end)

    def _load(self, exchange: Exchange) -> Load | None:
        """What an exchange whose turn it is sends; None: nothing that takes time."""
        requesting, answering = self._ends(exchange)
        if not exchange.requests or stage_of(exchange.requests[0]) is Stage.HEADER:
            answering.refresh()
            self._settle(answering)
        if exchange.requests:
            return request_load(exchange, answering.gossip)
        messages = size = 0
        data = False
        while not messages or not data:
            supplied = answering.gossip.supply(requesting.name)
            if supplied is None:
                exchange.dry = True
                break
            parts = supplied[1]
            exchange.supplied.append(parts)
            size += sum(map(len, parts))
            if parts[0][ID_BYTES] == CHUNKS:
                data = True
                messages += finished_in(parts)
                if self._channel.frame_by_frame:
                    break
        return Load(Stage.DATA, messages, size, 0) if data else None

    # Transmissions.

    def _end(self, exchange: Exchange) -> None:
        self._airtime.sent(exchange, self._queue.now_s)
        self._busy.remove(exchange.link)
        exchange.start_s = exchange.ready_s = exchange.load = None
        if exchange.supplied:
            self._hand_over(exchange)
        elif code_of(exchange.requests[0]) == SYNC1 or exchange.opened:
            exchange.opened = True
            while exchange.requests and not exchange.over:
                self._request(exchange, exchange.requests.popleft())
            self._greet(exchange)
        else:
            self._request(exchange, exchange.requests.popleft())
        self._arm(exchange)
        self._grant()

    def _hand_over(self, exchange: Exchange) -> None:
        """Frames of data arrive."""
        for parts in exchange.supplied:
            self._answer(exchange, parts)
        exchange.supplied.clear()

    def _greet(self, exchange: Exchange) -> None:
        """The other node's reply to an opening comes along with it."""
        requesting, answering = self._ends(exchange)
        supplied = answering.gossip.supply(requesting.name)
        if supplied is not None:
            self._answer(exchange, supplied[1])

    def _request(self, exchange: Exchange, request: bytes) -> None:
        """A request arrives, and what is answered at once comes back."""
        requesting, answering = self._ends(exchange)
        exchange.dry = False
        answering.gossip.request(requesting.name, exchange.route, [request], answering.now)
        self._settle(answering)
        replies, self._replies = self._replies, []
        for reply in replies:
            self._answer(exchange, [reply])

    def _answer(self, exchange: Exchange, parts: Sequence[bytes | memoryview]) -> None:
        """A frame arrives at the requesting node, unless it has hung up."""
        if not exchange.over:
            requesting, answering = self._ends(exchange)
            requesting.gossip.reply(answering.name, parts, requesting.now)
            self._settle(requesting)

    # Nodes.

    def settle(self) -> None:
        """Carry out what robots have had their nodes do by themselves."""
        for node in self._nodes:
            self._settle(node)

    def _settle(self, node: Node) -> None:
        more = True
        while more:
            actions, events = node.take()
            more = bool(actions or events)
            for action in actions:
                self._do(node, action)
            for event in events:
                if isinstance(event, SyncEnded | SyncTimedOut) and event.direction is Direction.IN:
                    broken = isinstance(event, SyncTimedOut)
                    self._airtime.broken += broken
                    self._airtime.complete += not broken
            if self._triggered and any(isinstance(event, MessageStored) for event in events):
                self._push(node)

    def _push(self, node: Node) -> None:
        """What is new here goes to those that pull from here, or still follow their last pull."""
        for exchange in list(self._exchanges.values()):
            if exchange.link.answering == node.number and exchange.dry:
                exchange.dry = False
                self._arm(exchange)

    def _do(self, node: Node, action: Action) -> None:
        if isinstance(action, Reply):
            self._replies.append(action.frame)
            return
        link = Link(node.number, self._numbers[action.peer])
        if isinstance(action, Connect):
            if link in self._exchanges:
                self._hang_up(self._exchanges[link])  # it followed
            self._count += 1
            self._exchanges[link] = Exchange(link, (self._count.to_bytes(8),))
            return
        exchange = self._exchanges[link]
        if isinstance(action, Send):
            exchange.requests.append(action.frame)
            self._arm(exchange)
        elif isinstance(action, Disconnect):
            self._hang_up(exchange)

    def _hang_up(self, exchange: Exchange) -> None:
        self._withdraw(exchange)
        exchange.over = True
        del self._exchanges[exchange.link]
        if exchange.again and self.in_contact(*exchange.link):
            self._queue.at(self._queue.now_s, lambda: self._pull_again(exchange.link))

    def _pull_again(self, link: Link) -> None:
        if link not in self._exchanges and self.in_contact(*link):
            self._pull(link)
            self._grant()
