"""How old what robots hold of each other is: exact, from every message that is made and delivered.

A robot holds a state of another one. Its age is the time since that state stopped being true: 0 as
long as the robot that made it would still publish the same. A map stops being true when one more
cell is seen, claims when one is made, kept or left; what is published on the other topics, when the
next message is made, which is when a peer requests it. A pose is true at its instant only. Before
the first delivery, ages count from when there was something to publish. The peak age is the mean of
the ages just before each delivery of an update; that at the end of a run is the last peak, unless
it is 0. docs/evidence/experiments.md#age-of-information names the sources of these measures.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from air_router.messages import MAP_TOPIC, PATH_TOPIC, POSE_TOPIC
from mocha_link.links import LinkEvent, MessageStored
from mocha_link.store import Header
from sitl.experiment import EventQueue
from sitl.world.explorers import CLAIMS_TOPIC, OBJECTS_TOPIC, REACHABILITY_TOPIC

USES: Final[Mapping[str, tuple[str, str, str]]] = {
    POSE_TOPIC: ("pose", "ugv", "uav"),
    PATH_TOPIC: ("path", "ugv", "uav"),
    MAP_TOPIC: ("map", "uav", "ugv"),
    CLAIMS_TOPIC: ("claims", "ugv", "ugv"),
    OBJECTS_TOPIC: ("objects", "ugv", "ugv"),
    REACHABILITY_TOPIC: ("reachability", "ugv", "ugv"),
}
"""What is measured: by topic its name in columns, which robots make it, and which ones use it."""

Numbers = npt.NDArray[np.float64]

Held = Numbers
"""What a robot held, a row for each update: (since when it held it, since when that was not
true any more; inf if it was true to the end). The first row is at 0 s: nothing was held yet."""

Pair = tuple[str, str, str]
"""A topic's name, the robot that makes it, the robot that uses it."""


@dataclass(slots=True)
class _Source:
    """A robot's messages on one topic.

    Attributes:
        state: What it would publish now; None: every message of it is another state.
        published: What it published last.
        false_s: By state that it published: since when the one before is not true any more. The
            last entry is of what it published last, and is inf as long as that is true.
        places: Of the states of its messages.
    """

    state: Callable[[], object] | None = None
    published: object = None
    false_s: list[float] = field(default_factory=lambda: [math.inf])
    places: dict[Header, int] = field(default_factory=dict)


class Ages:
    """Follows what robots publish and receive in a run; the queue has the time."""

    def __init__(self, queue: EventQueue) -> None:
        self._queue = queue
        self._sources: dict[tuple[str, str], _Source] = {}  # by robot and topic
        self._held: dict[tuple[str, str, str], list[tuple[float, int]]] = {}  # times and places

    def watch(self, robot: str, topic: str, state: Callable[[], object]) -> None:
        """A robot publishes on a topic whenever `state` has changed."""
        self._sources[robot, topic] = _Source(state, state())

    def update(self) -> None:
        """Robots have moved: note whose state differs from the last one it published."""
        for source in self._sources.values():
            if source.state:
                differs = source.state() != source.published
                before_s = source.false_s[-1]
                source.false_s[-1] = min(before_s, self._queue.now_s) if differs else math.inf

    def listener(
        self, robot: str, receive: Callable[[LinkEvent], None]
    ) -> Callable[[LinkEvent], None]:
        """Follow a robot's link events, and pass them on."""

        def listen(event: LinkEvent) -> None:
            if isinstance(event, MessageStored) and event.topic in USES:
                self._stored(robot, event)
            receive(event)

        return listen

    def _stored(self, robot: str, event: MessageStored) -> None:
        now_s = self._queue.now_s
        key = event.robot, event.topic
        if event.robot == robot:
            source = self._sources.setdefault(key, _Source())
            state = source.state() if source.state else event.header
            if state != source.published or not source.places:
                source.published = state
                source.false_s[-1] = min(source.false_s[-1], now_s)
                source.false_s.append(now_s if event.topic == POSE_TOPIC else math.inf)
            source.places[event.header] = len(source.false_s) - 2
            return
        if key in self._sources:  # the base station is not followed
            place = self._sources[key].places[event.header]
            held = self._held.setdefault((event.topic, event.robot, robot), [])
            if not held or place > held[-1][1]:
                held.append((now_s, place))

    def held(self, robots: Sequence[str], kinds: Sequence[str]) -> dict[Pair, Held]:
        """What each robot held of each other one, of all that is used."""
        found: dict[Pair, Held] = {}
        for topic, (name, maker, user) in USES.items():
            for robot, kind in zip(robots, kinds, strict=True):
                source = self._sources.get((robot, topic), _Source())
                first_s = 0.0 if topic == POSE_TOPIC else source.false_s[0]
                for other, use in zip(robots, kinds, strict=True):
                    if (kind, use) == (maker, user) and robot != other:
                        own = self._held.get((topic, robot, other), [])
                        rows = [(time_s, source.false_s[place + 1]) for time_s, place in own]
                        found[name, robot, other] = np.array([(0.0, first_s), *rows])
        return found


def mean_age_s(held: Held, end_s: float) -> float:
    """The mean age over the whole run: the area under the saw teeth."""
    began_s, false_s = held.T
    ended_s = np.append(began_s[1:], end_s)
    low_s, high_s = (np.maximum(times_s - false_s, 0.0) for times_s in (began_s, ended_s))
    return float((high_s**2 - low_s**2).sum()) / 2 / end_s


def mean_value(held: Held, end_s: float, half_life_s: float) -> float:
    """The mean worth over the whole run: 1 of what is true, and half for each half-life of age.

    Args:
        held: What was held; what is not there yet has its age, too.
        end_s: When the run ended.
        half_life_s: The age at which it is worth half.
    """
    began_s, false_s = held.T
    ended_s = np.append(began_s[1:], end_s)
    true_s = np.clip(false_s - began_s, 0.0, ended_s - began_s)
    low_s, high_s = (np.maximum(times_s - false_s, 0.0) for times_s in (began_s, ended_s))
    rate_1_s = math.log(2) / half_life_s
    decayed_s = (np.exp(-rate_1_s * low_s) - np.exp(-rate_1_s * high_s)) / rate_1_s
    return float((true_s + decayed_s).sum()) / end_s


def peak_age_s(held: Held, end_s: float) -> float | None:
    """The mean of the peaks; None: there was never anything to hold."""
    peaks_s = np.maximum(np.append(held[1:, 0], end_s) - held[:, 1], 0.0)
    if not peaks_s[-1]:
        peaks_s = peaks_s[:-1]
    return float(peaks_s.mean()) if len(peaks_s) else None
