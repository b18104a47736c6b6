"""A robot's gossip node in simulated time: `mocha_link`'s own, without sockets and threads.

The base station of a run is hardly more than its node: it stands at home, and tells whom it meets
which goals it knows.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Final

from air_router.messages import POSE_TOPIC, PoseMessage
from mocha_link.clock import Instant
from mocha_link.links.link_events import ContactBegan, ContactEnded, LinkEvent, MessageStored
from mocha_link.links.trigger import NOT_HEARD
from mocha_link.node.gossip import Gossip
from mocha_link.store import payload
from mocha_link.sync.actions import Action
from mocha_link.sync.protocol import ID_BYTES
from mocha_link.team.team import Team
from sitl.experiment.events import EventQueue
from sitl.experiment.robots.messages import TARGETS_TOPIC, degrees, target_goals
from sitl.world.towns.town import Town

EPOCH_S: Final = 26_000 * 65_536 + 3_600.0
"""Unix seconds at the beginning of a run: no header's time wraps within 17 hours of it."""

REFRESH_S: Final = 1.0
"""A robot publishes at most so often; and nothing while no peer asks, since only the newest message
of a topic is ever exchanged."""


class Node:
    """A node, and what its robot does with it.

    Args:
        number: Of the robot in the run.
        name: Its name in the team.
        queue: Tells the time.
        triggered: Its own trigger begins pulls, and pulls that are over follow.
        publish: Asks the robot for what it has to say: (topic, data), at most one per topic.
        hear: Tells the robot what has happened on its links.
    """

    def __init__(  # noqa: PLR0913 - what connects a robot with others
        self,
        number: int,
        name: str,
        team: Team,
        queue: EventQueue,
        *,
        triggered: bool = False,
        publish: Callable[[], list[tuple[str, bytes]]],
        hear: Callable[[LinkEvent], None],
    ) -> None:
        self.number = number
        self.name = name
        ids = itertools.count(number << 32)
        self.gossip = Gossip(
            team,
            name,
            by_timer=False,
            new_id=lambda: next(ids).to_bytes(ID_BYTES),
            datagrams=False,
            follow=triggered,
        )
        self.triggered = triggered  # else pulls are begun for it
        self._heard_dbm = team.trigger.rssi_threshold_dbm  # what its radio says in a contact
        self._queue = queue
        self._publish = publish
        self._hear = hear
        self._topics = {topic.name: topic for topic in team.topics_of(name)}  # that it may publish
        self._fresh_s = -REFRESH_S  # simulated time at which its robot spoke last

    @property
    def now(self) -> Instant:
        """The present, as the node sees it."""
        return Instant(EPOCH_S + self._queue.now_s, self._queue.now_s)

    def refresh(self) -> None:
        """A peer is about to be told what is new: let the robot speak first."""
        if self._queue.now_s - self._fresh_s >= REFRESH_S:
            self._fresh_s = self._queue.now_s
            for topic, data in self._publish():
                self.publish(topic, data)

    def publish(self, topic: str, data: bytes) -> None:
        """Put a message into the database; topics that the team does not have are left out."""
        known = self._topics.get(topic)
        if known is not None:
            self.gossip.publish(known, data, self.now, at_once=True)

    def contact(self, peer: str, began_s: float, *, up: bool) -> None:
        """The radio hears a peer, or not any more: the robot is told, as by a node with a radio."""
        at_s = self.now.unix_s
        if self.triggered:
            self.gossip.heard(peer, self._heard_dbm if up else None, self.now)
        elif up:
            self._hear(ContactBegan(peer, at_s, None))
        else:
            self._hear(ContactEnded(peer, at_s, self._queue.now_s - began_s, NOT_HEARD))

    def take(self) -> tuple[list[Action], list[LinkEvent]]:
        """What the node wants done, and of what it told its robot."""
        actions, events = self.gossip.take()
        for event in events:
            self._hear(event)
        return actions, events

    def data_of(self, event: MessageStored) -> bytes:
        """The message that an event tells of."""
        record = self.gossip.database.get(event.header)
        return b"" if record is None else payload.unpack(record.body)


class BaseStation:
    """A station that does not move.

    Args:
        goals: Ids of the goals that it knows.

    Raises:
        ValueError: the town has no such goal.
    """

    def __init__(self, town: Town, goals: tuple[str, ...], queue: EventQueue) -> None:
        places = {goal.id: goal.position for goal in town.goals}
        for goal in goals:
            if goal not in places:
                raise ValueError(
                    f"base_goals: {town.name} has no goal '{goal}'; use {', '.join(places)}"
                )
        self.position = town.home  # it never moves
        self._queue = queue
        self._frame = town.frame  # for degrees
        self._goals = [places[goal] for goal in goals]  # east, north
        self._told = False  # once is enough: gossip carries them on

    def say(self) -> list[tuple[str, bytes]]:
        """What it has to say to a peer that asks now."""
        stamp_s = EPOCH_S + self._queue.now_s
        latitude_deg, longitude_deg = degrees(self._frame, self.position)
        pose = PoseMessage(stamp_s=stamp_s, latitude_deg=latitude_deg, longitude_deg=longitude_deg)
        said = [(POSE_TOPIC, pose.encode())]
        if self._goals and not self._told:
            self._told = True
            said.append((TARGETS_TOPIC, target_goals(stamp_s, self._goals, self._frame)))
        return said
