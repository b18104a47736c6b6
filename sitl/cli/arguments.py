"""What commands of `sitl` take alike, read from a command line.

Apart from the commands: `sitl team` needs no simulated autopilot.
"""

from typing import Final

from air_router.cli import MORE_THAN_0, number
from air_router.vehicle import PaceSource

_MOST_INSTANCES: Final = 250

epoch = number("a time in Unix seconds", MORE_THAN_0, 2.0**32)
"""Unix seconds."""


def pace_source(text: str) -> PaceSource:
    """Where the pace of a simulation is set."""
    try:
        return PaceSource.of(text)
    except ValueError:
        raise ValueError(f"'{text}' is not HOST:PORT; write 127.0.0.1:24900") from None


def instance(text: str) -> int:
    """A PX4 instance of a command line."""
    if not text.isdecimal() or int(text) > _MOST_INSTANCES:
        raise ValueError(f"'{text}' is not an instance; write 0 to {_MOST_INSTANCES}")
    return int(text)
