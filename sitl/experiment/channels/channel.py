"""The radio channel as the engine sees it: a port with several models behind it; the paper's model.

A model says who is in contact, how long a transmission takes, which transmissions exclude each
other, and in which order those that wait get their turn. What moves is in `engine.channel_sim`.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from mocha_link.node.gossip import TIMEOUT_S
from sitl.experiment.settings import PaperModel

Places = npt.NDArray[np.float64]
"""(robots, 3): east, north, height above ground, in metres."""


class Stage(IntEnum):
    """What a transmission is for; the paper's three stages."""

    HEADER = 0
    DATA = 1
    END = 2


class Link(NamedTuple):
    """One direction of pulling: robots by their number in the run."""

    asking: int
    answering: int


class Load(NamedTuple):
    """What a transmission carries.

    Attributes:
        messages: Robots' messages that arrive whole with it.
        size: Bytes, of the request and of what answers it.
        round_trips: How often one side must wait for the other before it is over.
    """

    stage: Stage
    messages: int
    size: int
    round_trips: int


class Change(NamedTuple):
    """Two robots (a < b) come into contact, or lose it."""

    a: int
    b: int
    up: bool


class Channel(Protocol):
    """A model of the radio channel. Deterministic: seeded, and asked in a fixed order.

    Attributes:
        patience_s: So long an exchange that has lost contact waits for it to come back.
        pull_every_s: In a contact robots pull again so often; None: once, when it begins.
        frame_by_frame: Frames of our protocol cross one at a time; otherwise together until a
            message is whole.
    """

    patience_s: float
    pull_every_s: float | None
    frame_by_frame: bool

    def look(self, now_s: float, places: Places) -> list[Change]:
        """Contacts that began or ended since the last look, in order of the robots' numbers."""

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:
        """How long a transmission that begins now takes."""

    def turn(self, link: Link, ready_s: float) -> tuple[float, ...]:
        """Sorts those that wait for the channel; the least is next."""

    def pick(self, waiting: Iterable[Link], busy: Sequence[Link]) -> int | None:
        """Which of those that wait may begin beside those under way; None: none may."""


class SpatialReuse:
    """What channels have in common on which robots that do not hear each other send at once.

    Args:
        pull_every_s: As `Channel` says.
        count: How many robots there are.
    """

    patience_s = TIMEOUT_S
    frame_by_frame = True

    def __init__(self, pull_every_s: float | None, count: int) -> None:
        self.pull_every_s = pull_every_s  # None: only when a contact begins
        self._hears: list[set[int]] = [{number} for number in range(count)]  # and itself

    def turn(self, link: Link, ready_s: float) -> tuple[float, ...]:
        """Who has waited longest."""
        return (ready_s, *link)

    def pick(self, waiting: Iterable[Link], busy: Sequence[Link]) -> int | None:
        """The first that disturbs no transmission and is not disturbed."""
        deaf = {number for link in busy for each in link for number in self._hears[each]}
        for place, (asking, answering) in enumerate(waiting):
            if asking not in deaf and answering not in deaf:
                return place
        return None


class PaperChannel:
    """Exponential latencies per stage, one transmission at a time anywhere, contact by radius.

    Args:
        model: Rates and readings.
        radius_m: Horizontal distance below which two robots are in contact.
        robots: How many there are.
        seed: Makes the latencies.
    """

    def __init__(self, model: PaperModel, radius_m: float, robots: int, seed: int) -> None:
        patience_s = {"timeout": model.timeout_s, "hold": math.inf, "drop": 0.0}
        self.patience_s = patience_s[model.cut]  # from the loss of contact to giving up
        self.pull_every_s = model.pull_every_s  # None: only when a contact begins
        self._order = model.order  # of those that wait: arrival, random or by number
        self.frame_by_frame = model.piece == "frame"  # else a piece of data is a whole message
        self._radius_m = radius_m
        self._rates_1_s = {  # of the exponential latencies
            Stage.HEADER: model.header_rate_1_s,
            Stage.DATA: model.data_rate_1_s,
            Stage.END: model.end_rate_1_s,
        }
        self._chance = random.Random(f"{seed} channel")  # noqa: S311 - repeatable on purpose
        self._near = np.zeros((robots, robots), dtype=bool)  # in contact at the last look
        self._upper = np.triu(np.ones((robots, robots), dtype=bool), 1)  # each pair once

    def look(self, now_s: float, places: Places) -> list[Change]:  # noqa: ARG002 - a port's
        """Who came nearer than the radius, horizontally, and who went."""
        east, north = places[:, 0], places[:, 1]
        squared = (east[:, None] - east) ** 2 + (north[:, None] - north) ** 2
        near = squared < self._radius_m**2
        changed = np.argwhere((near != self._near) & self._upper)
        self._near = near
        return [Change(int(a), int(b), bool(near[a, b])) for a, b in changed]

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:  # noqa: ARG002
        """A latency of the stage; of data one for each message, unless a frame counts as one."""
        rate_1_s = self._rates_1_s[load.stage]
        count = load.stage is Stage.DATA and not self.frame_by_frame
        pieces = max(load.messages, 1) if count else 1
        return math.fsum(self._latency_s(rate_1_s) for _ in range(pieces))

    def turn(self, link: Link, ready_s: float) -> tuple[float, ...]:
        """As the model's reading has it."""
        if self._order == "arrival":
            return (ready_s, *link)
        if self._order == "random":
            return (self._chance.random(), *link)
        return link

    def pick(self, waiting: Iterable[Link], busy: Sequence[Link]) -> int | None:  # noqa: ARG002
        """The first, unless any robot sends anywhere."""
        return None if busy else 0

    def _latency_s(self, rate_1_s: float) -> float:
        return -math.log(1.0 - self._chance.random()) / rate_1_s
