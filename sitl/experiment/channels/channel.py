"""The radio channel as the engine sees it: a port with several models behind it.

A model says who is in contact, how long a transmission takes, which transmissions exclude each
other, and in which order those that wait get their turn. It moves nothing itself; see `air`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

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
