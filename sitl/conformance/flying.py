"""The steps about where the vehicle is and how it flies."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from sitl.conformance.session import DepartureError, Session, Where


def arrives(
    session: Session, place: Sequence[float | None], near_m: float = 2.0, within_s: float = 60.0
) -> None:
    """The vehicle comes near a place, metres north, east and up.

    An axis that is None or not given does not matter.
    """

    def near() -> bool:
        here = session.position
        axes = zip(place, (here.north_m, here.east_m, here.up_m), strict=False)
        return math.hypot(*(wanted - is_ for wanted, is_ in axes if wanted is not None)) <= near_m

    if not session.run(within_s, near):
        raise DepartureError(
            f"expected it within {near_m:g} m in {within_s:g} s, it is at {session.position}"
        )


@dataclass(frozen=True)
class Measure:
    """Something measured while it flies for some seconds, to be compared with limits.

    Attributes:
        of: What is measured, from the places before and during that time.
        note: How it is told.
    """

    of: Callable[[Sequence[Where]], float]
    note: str

    def __call__(self, session: Session, between: Sequence[float], for_s: float) -> None:
        """Measure it.

        Raises:
            DepartureError: it is not within the limits.
        """
        start, first = session.position, len(session.track)
        session.run(for_s)
        track = [start, *session.track[first:]]
        value = self.of(track)
        session.notes.append(self.note.format(value, track[-1]))
        if not between[0] <= value <= between[1]:
            limits = f"{between[0]:g} to {between[1]:g}"
            raise DepartureError(f"expected {limits} in {for_s:g} s, it {session.notes[-1]}")


def _strayed_m(track: Sequence[Where]) -> float:
    start = track[0]
    return max(
        math.hypot(place.north_m - start.north_m, place.east_m - start.east_m) for place in track
    )


def _speed_m_s(track: Sequence[Where]) -> float:
    flown = track[1:]
    pairs = itertools.pairwise(flown)
    way_m = sum(math.hypot(b.north_m - a.north_m, b.east_m - a.east_m) for a, b in pairs)
    return way_m / max(flown[-1].at_s - flown[0].at_s, 0.1)


def _climb_m_s(track: Sequence[Where]) -> float:
    start, end = track[0], track[-1]
    return (end.up_m - start.up_m) / max(end.at_s - start.at_s, 0.1)


STRAYS: Final = Measure(_strayed_m, "left its place by {:.1f} m")
SPEED: Final = Measure(_speed_m_s, "{:.1f} m/s")
CLIMB: Final = Measure(_climb_m_s, "climbed {:.2f} m/s")
FURTHEST: Final = Measure(
    lambda track: max(place.north_m for place in track[1:]), "came {:.1f} m north, is at {}"
)
