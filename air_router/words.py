"""Words for numbers of things (one zone, two zones), for directions, and for the wind. Pure."""

import math
from typing import Final

_POINTS: Final = (
    *("north", "north-east", "east", "south-east"),
    *("south", "south-west", "west", "north-west"),
)


def direction(east: float, north: float) -> str:
    """Where a vector points to, as one of eight points of the compass."""
    return _POINTS[round(math.degrees(math.atan2(east, north)) / 45.0) % 8]


def wind_words(wind_m_s: tuple[float, float]) -> str:
    """A wind, given by how the air moves (east, north): how strong it is, and from where."""
    east_m_s, north_m_s = wind_m_s
    return f"{math.hypot(east_m_s, north_m_s):.0f} m/s from {direction(-east_m_s, -north_m_s)}"


def counted(count: int, things: str) -> str:
    """A count and what is counted; `things` is the plural, its first word to end in s loses it.

    `counted(1, "zones of the file")` is "1 zone of the file".
    """
    if count != 1:
        return f"{count} {things}"
    words = things.split(" ")
    place = next((i for i, word in enumerate(words) if word.endswith("s")), None)
    if place is not None:
        words[place] = words[place].removesuffix("s")
    return " ".join(("1", *words))
