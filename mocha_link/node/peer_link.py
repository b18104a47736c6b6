"""The link to each peer of a node: its session, and the node's state for it."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from functools import partial

from mocha_link.links import LinkTable
from mocha_link.store import Verifier
from mocha_link.sync import NodeContext, Peer, Session
from mocha_link.team import Robot, Trust


@dataclass(slots=True)
class PeerLink:
    """The session with one peer, and the node's state for it."""

    session: Session
    known_hash: int = 0  # the peer's configuration hash, if its team file differs
    differs: str | None = None  # the topics that are not exchanged then, for the log
    pushes: bool = False  # at the last check, it pushed everything that it stores

    @property
    def peer(self) -> Peer:
        """The state of the peer that outlives a pull."""
        return self.session.peer


class PeerLinks:
    """The links of a robot. A turn of the node processes only links with input or a due timer.

    Messages are verified if the team has keys or requires them.

    Attributes:
        by_peer: All links.
        touched: Peers with input since `settle`.

    Raises:
        KeyMismatchError: a key in the team file is invalid.
        KeysUnavailableError: the team has keys, and PyNaCl is missing.
    """

    def __init__(
        self,
        context: NodeContext,
        me: Robot,
        link_table: LinkTable,
        *,
        datagrams: bool,
        both_ways: bool,
    ) -> None:
        self._database, self._team = context.database, context.team
        self.by_peer: dict[str, PeerLink] = {}
        self.touched: set[str] = set()
        self._followed = context.followed  # robots that push to us
        self._last_followed: set[int] = set()  # the same at the last `push_otherwise`
        self._wakes_s: dict[str, float] = {}  # by peer: when a timer expires, steady seconds
        team = context.team
        verifier = Verifier(team)
        verifies = team.trust is Trust.SIGNED or any(robot.key for robot in team.robots.values())
        for name in me.peers:
            peer = Peer(
                name,
                context,
                verify=partial(verifier.verify, handed_by=name) if verifies else None,
                original=team.robot(name).original,
                datagrams=datagrams,
                budget_bytes=team.trigger.budget_bytes or 0,
                pushed=team.pushed(me, name),
            )
            self.by_peer[name] = PeerLink(Session(peer, link_table, both_ways=both_ways))

    def __iter__(self) -> Iterator[PeerLink]:
        return iter(self.by_peer.values())

    def ages_s(self, now_s: float) -> dict[str, dict[str, float]]:
        """The ages of the newest messages by peer and topic, at Unix time `now_s`."""
        newest = self._database.newest
        return {
            peer: {
                topic.name: max(now_s - min(record.stamp_s, record.received_s), 0.0)
                for topic in self._team.topics_of(peer)
                if (record := newest(self._team.robot(peer).robot_id, topic.topic_id))
            }
            for peer in self.by_peer
        }

    def stored(self, robot_ids: AbstractSet[int]) -> None:
        """Mark the peers that want a push of newly stored messages of these robots."""
        self.touched.update(
            p for p, link in self.by_peer.items() if link.session.wants_push(robot_ids)
        )

    def push_otherwise(self) -> bool:
        """Update which peers push; returns whether one has begun or stopped.

        What a peer pushes also depends on the other peers that we follow.
        """
        candidates = self.touched if self._followed == self._last_followed else self.by_peer.keys()
        self._last_followed = set(self._followed)
        changed = False
        for link in map(self.by_peer.__getitem__, candidates):
            pushes = link.session.has_all
            changed |= pushes != link.pushes
            link.pushes = pushes
        return changed

    def busy(self, now_s: float) -> list[PeerLink]:
        """The links with input since `settle`, or with an expired timer."""
        self.touched.update(p for p, wake_s in self._wakes_s.items() if wake_s <= now_s)
        return [link for peer, link in self.by_peer.items() if peer in self.touched]

    def settle(self) -> None:
        """Note that all input is processed; the links now wait for their timers."""
        self._note_wakes()
        self.touched.clear()

    def _note_wakes(self) -> None:
        for peer in self.touched:
            wake_s = self.by_peer[peer].session.wake_s
            if wake_s is None:
                self._wakes_s.pop(peer, None)
            else:
                self._wakes_s[peer] = wake_s

    @property
    def wake_s(self) -> float | None:
        """When the first timer expires, in steady seconds; None: no timer runs."""
        self._note_wakes()
        return min(self._wakes_s.values(), default=None)
