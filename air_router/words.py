"""Words for numbers of things (one zone, two zones), times, progress, directions and wind. Pure."""

import math
from typing import Final

_BAR: Final = 24  # characters
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


def duration_text(time_s: float) -> str:
    """A duration in the unit that suits it: seconds, minutes or hours."""
    if time_s < 90:
        return f"{time_s:.0f} s"
    if time_s < 5400:
        return f"{time_s / 60:.0f} min"
    return f"{time_s / 3600:.1f} h"


def progress_text(done: int, count: int, things: str, elapsed_s: float) -> str:
    """A bar, how many of `count` things are done, and an estimate of the time that is left."""
    full = round(_BAR * done / max(count, 1))
    text = f"[{'#' * full}{'.' * (_BAR - full)}] {done} of {counted(count, things)}"
    if not 0 < done < count:
        return text
    return f"{text}, about {duration_text(elapsed_s * (count / done - 1))} left"
