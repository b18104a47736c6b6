"""The asking side of one peer: its pulls, one after the other, and what is pushed between them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from mocha_link.clock import Instant
from mocha_link.datagram.datagram import Flow
from mocha_link.links.metrics import LinkTable
from mocha_link.sync.actions import Action, Connect, Disconnect, Send, SendDatagram
from mocha_link.sync.frames import Frame, Step
from mocha_link.sync.peer_state import PeerState
from mocha_link.sync.protocol import ID_BYTES
from mocha_link.sync.pull import PathStats, Pull, PullContext
from mocha_link.sync.server import FOLLOW_S
from mocha_link.sync.sync_receiver import Verify

STALLED_S = 1.0  # a pull without a byte for so long does not outlive a new contact
LINGER_S = 2.0  # so long the end of a sync is repeated to a peer that asks again
LEAST_BUDGET = 1024  # with less left no pull begins


class Puller:
    """Pulls from one peer when told to, and takes in what it pushes.

    A pull that ends well leaves the peer *followed*: on its connection or flow comes what the peer
    stores. The next pull goes on over a connection that stands.

    Args:
        original: the peer is known to run the original node.
        datagrams: there is a socket for them.
        budget_bytes: that may come in during a contact; 0: no limit.
        act: takes what is to be done at the sockets.
        tell: takes the refusals and events of every step.
    """

    def __init__(  # noqa: PLR0913 - all it needs to know, once
        self,
        peer: str,
        pull_context: PullContext,
        peer_state: PeerState,
        *,
        verify: Verify | None,
        original: bool,
        datagrams: bool,
        budget_bytes: int,
        link_table: LinkTable,
        act: Callable[[Action], None],
        tell: Callable[[str, Step, Instant], None],
    ) -> None:
        self.peer = peer  # its name
        self.pull: Pull | None = None  # the one under way
        self.followed: Pull | None = None  # that is over, and on which the peer pushes
        self.path_stats = PathStats()  # what pulls have shown of the way
        self._pull_context = pull_context  # what all pulls of the node share
        self._peer_state = peer_state  # what is remembered of the peer
        self._verify = verify  # refuses messages that the peer may not hand over
        self._original = original  # asked as original nodes ask
        self._datagrams = datagrams  # whether they may be tried
        self._budget_bytes = budget_bytes  # of a contact
        self._spent_bytes = 0  # of it
        self._ending: tuple[Flow, float] | None = None  # says END until that steady time
        self._link_table = link_table  # counts what comes in
        self._act = act
        self._tell = tell

    def sync(self, now: Instant) -> bool:
        """Begin a pull; False if one is under way, or the contact's budget is used up."""
        left = self._budget_bytes - self._spent_bytes if self._budget_bytes else 0
        if self.pull or (self._budget_bytes and left < LEAST_BUDGET):
            return False
        self._begin(left, now, standing=self.followed is not None and self.followed.path == "zmq")
        return True

    def renew_budget(self) -> None:
        """A contact begins, or what counts as one."""
        self._spent_bytes = 0

    def reply(self, parts: Sequence[Frame], now: Instant) -> None:
        """Take in what came back on the connection."""
        pull, followed = self.pull, self.followed
        if pull is None or (followed and parts and parts[0][:ID_BYTES] == followed.id):
            pull = followed  # pushed before the peer had heard of the pull that is under way
        if pull:
            self._count_in(sum(map(len, parts)))
            self._take(pull, pull.reply(parts, now), now)

    def packet(self, packet: bytes, now: Instant) -> None:
        """Take in a datagram that the peer sent in answer to ours."""
        pull = self.pull or self.followed
        if pull and pull.flow and packet[1 : 1 + ID_BYTES] == pull.flow.token:
            self._count_in(len(packet))
            self._take(pull, pull.packet(packet, now), now)
        elif self._ending:
            flow, _ = self._ending
            flow.receive(packet, now.steady_s)
            self._cast(flow.transmit(now.steady_s))

    def progress(self, now: Instant, rtt_s: float | None) -> None:
        """The connection stands, or bytes arrive on it; its round trip, if known."""
        if self.pull:
            self.pull.progress(now)
            if rtt_s is not None:
                self.pull.measured(rtt_s)

    def lost(self, reason: str, now: Instant) -> None:
        """The connection is gone."""
        pull = self.pull
        if pull and pull.standing:
            self._begin_afresh(pull, now)
            return
        self.unfollow()
        if pull:
            self._take(pull, pull.disconnected(reason, now), now)

    def on_contact(self, now: Instant) -> None:
        """A contact begins: do not wait for the timers of a pull that stalls."""
        pull = self.pull
        if pull is None or now.steady_s - pull.alive_s <= STALLED_S:
            return
        if pull.path == "udp":
            self._take(pull, pull.on_contact(now), now)
        else:
            # Its connection sleeps in TCP's back-off; a fresh one gets through at once.
            self._take(pull, pull.fail("stalled, and a new contact began", now), now)

    def tick(self, now: Instant) -> None:
        """Do what is due by the time alone."""
        pull, followed = self.pull, self.followed
        if pull and pull.is_in_vain(now):
            self._begin_afresh(pull, now)
        elif pull:
            self._take(pull, pull.tick(now), now)
        if followed and followed is self.followed:
            if followed.wake_s is not None and followed.wake_s <= now.steady_s:
                self._take(followed, followed.tick(now), now)
            if now.steady_s - followed.alive_s > FOLLOW_S:
                self.unfollow()
        if self._ending:
            flow, until_s = self._ending
            self._cast(flow.transmit(now.steady_s))
            if flow.settled or now.steady_s > until_s:
                self._ending = None

    def unfollow(self) -> None:
        """Take in nothing more of what the peer pushes, if it does."""
        followed, self.followed = self.followed, None
        if followed and followed.path != "udp" and not self.pull:
            self._act(Disconnect(self.peer, void=True))

    @property
    def is_busy(self) -> bool:
        """Whether a pull is under way, or its end is being said."""
        return self.pull is not None or self._ending is not None

    @property
    def wake_s(self) -> float | None:
        """When to call `tick` at the latest, in steady seconds; None: no hurry."""
        times = [pull.wake_s for pull in (self.pull, self.followed) if pull]
        if self._ending:
            times.append(self._ending[0].wake_s)
        return min((each for each in times if each is not None), default=None)

    def _begin(self, budget: int, now: Instant, *, standing: bool, again: bool = False) -> None:
        pull = self.pull = Pull(
            self.peer,
            self._pull_context,
            self.path_stats,
            self._peer_state,
            verify=self._verify,
            original=self._original,
            datagrams=self._datagrams,
            standing=standing,
            budget=budget,
        )
        if not standing:
            self.followed = None
            self._act(Connect(self.peer))
        step = pull.start(now)
        if again:
            step.events.clear()
        self._take(pull, step, now)

    def _begin_afresh(self, pull: Pull, now: Instant) -> None:
        """Go on over a new connection where the one that stood is gone; the same pull to all."""
        pull.fail("the connection that stood is gone", now)
        left = self._budget_bytes and max(self._budget_bytes - self._spent_bytes, LEAST_BUDGET)
        self._begin(left, now, standing=False, again=True)

    def _take(self, pull: Pull, step: Step, now: Instant) -> None:
        for frame in step.frames:
            self._act(Send(self.peer, frame))
        self._cast(step.packets)
        if pull.over and self.pull is pull:
            self._finish(pull, now)
        self._tell(self.peer, step, now)

    def _finish(self, pull: Pull, now: Instant) -> None:
        self._link_table.measure(
            self.peer,
            rtt_s=pull.rtt_s,
            bandwidth_bytes_s=pull.throughput_bytes_s,
            path=pull.path,
        )
        self.pull, self.followed = None, pull if pull.follows else None
        if not pull.follows or pull.path == "udp":
            self._act(Disconnect(self.peer, pull.broken or pull.path == "udp"))
        if pull.flow and pull.path == "udp" and not pull.follows:
            self._cast(pull.flow.transmit(now.steady_s))
            self._ending = (pull.flow, now.steady_s + LINGER_S)

    def _cast(self, packets: Iterable[bytes]) -> None:
        for packet in packets:
            self._act(SendDatagram(self.peer, packet))

    def _count_in(self, size: int) -> None:
        self._spent_bytes += size
        self._link_table.count(self.peer, bytes_in=size)
