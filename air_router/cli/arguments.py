"""What several commands have in common: arguments, how they are read, and how they answer."""

import json
import math
import sys
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

from air_router.vehicle.px4 import FLOWN, NEWEST, Version, name_of
from geo.frame import FrameError, Geodetic, LocalFrame
from geo.validity import moment_of
from mocha_link.cli import Decorator, Options, Parsed, option, together
from mocha_link.team import decimal_degrees, number_advice, pair_in, plain

_VERSIONS = ", ".join(map(name_of, FLOWN))


def print_json(facts: Any) -> None:
    """What `--json` prints: one object on a line of its own, at once."""
    json.dump(facts, sys.stdout)
    sys.stdout.write("\n")
    sys.stdout.flush()


def say(text: str) -> None:
    """Print a line for the operator, on stderr and at once."""
    print(text, file=sys.stderr, flush=True)


def _px4_version(text: str) -> Version:
    for version in FLOWN:
        if text == name_of(version):
            return version
    raise ValueError(f"'{text}' is none of {_VERSIONS}")


def _rover(text: str) -> tuple[str, str]:
    name, _, endpoint = text.partition("=")
    if not name or not endpoint.startswith(("ipc://", "tcp://")):
        raise ValueError(f"{text} is not NAME=ENDPOINT; write it like rover=ipc:///tmp/rover")
    return name, endpoint


def number(what: str, lowest: float, highest: float) -> Callable[[str], float]:
    """The type of an argument that is a number from `lowest` to `highest`.

    Args:
        what: What the text is not, if it is none: "a speed between 0.1 and 100".
        lowest: The least; `MORE_THAN_0` where 0 is too little.
        highest: The largest; `ANY_FINITE` where none is too large.
    """

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not lowest <= value <= highest:
            advice = number_advice(text)
            message = f"{text} is not {what}{f'; {advice}' * bool(advice)}"
            raise ValueError(message)
        return value

    return read


def note_options(arguments: Options, fields: Mapping[str, str]) -> None:
    """Note options whose values are not usual.

    Args:
        arguments: The command line.
        fields: Of each option, by its name among the arguments, the field of `usual_values`.
    """
    from air_router.files import option_notes  # noqa: PLC0415 - few commands need it

    given = ((f"--{name}", getattr(arguments, name), field) for name, field in fields.items())
    for note in option_notes(given):
        say(note)


_FIRST_YEAR, _LAST_YEAR = 1970, 9000  # of flights: before and after there is time left to reckon

MORE_THAN_0, ANY_FINITE = sys.float_info.min, sys.float_info.max
speed_factor = number("a speed between 0.1 and 100", 0.1, 100.0)
"""Of a simulation or a recorded flight, times real time."""


def place(text: str) -> Geodetic:
    """An argument LAT,LON in degrees.

    Raises:
        ValueError: it is none.
    """
    try:
        latitude_deg, longitude_deg = map(float, text.split(","))
    except ValueError:
        message = f"{text} is not LATITUDE,LONGITUDE{_place_advice(text)}"
        raise ValueError(message) from None
    return Geodetic(latitude_deg, longitude_deg)


def _place_advice(text: str) -> str:
    """What to write instead of a text that was to be a place, behind a semicolon."""
    halves = [decimal_degrees(plain(half)) for half in text.split(",")]
    if pair := pair_in(text.strip()):
        return f"; write {pair.strip('[]').replace(' ', '')}"
    if len(halves) == 2 and all(halves):
        return f"; write decimal degrees: {','.join(map(str, halves))}"
    if "," not in text:
        return "; write both as one argument, with a comma and no blank"
    return ""


def home(text: str) -> Geodetic:
    """An argument LAT,LON in degrees where a mission may begin.

    Raises:
        ValueError: it is none, or not on Earth.
    """
    given = place(text)
    try:
        return LocalFrame(given).origin
    except FrameError as error:
        raise ValueError(f"{text}: {error}") from None


def moment(text: str) -> datetime:
    """An argument that is a time with its time zone.

    Raises:
        ValueError: it is none, or at an end of the calendar.
    """
    try:
        given = moment_of(text)
    except ValueError as error:
        raise ValueError(f"{text} is {error}") from None
    if not _FIRST_YEAR <= given.year <= _LAST_YEAR:
        years = f"the years {_FIRST_YEAR} to {_LAST_YEAR}"
        raise ValueError(f"{text} is not in {years}")
    return given


# Options that several commands take.

start_option = option(
    "--at",
    type=Parsed(moment),
    metavar="TIME",
    help="time at which the mission starts, e.g. 2026-11-20T08:00:00Z (default: now); zones may "
    "depend on it",
)
"""Add `--at`: when the mission is to start, for zones that do not apply at all times."""


uav_option = option(
    "--uav",
    metavar="NAME",
    help="UAV to use, if the mission file has several (`uavs`)",
)
"""Add `--uav`: whose mission it is, where it is for several."""


rover_option = option(
    "--rover",
    multiple=True,
    type=Parsed(_rover),
    metavar="NAME=ENDPOINT",
    help="your own program plays robot NAME: the simulation serves the robot's node at ENDPOINT, "
    "and the program sets its position, e.g. rover=ipc:///tmp/rover (docs/robot.md); may be "
    "repeated",
)
"""Add `--rover`: which robots of a simulation the user's own programs play."""


def px4_version_option(purpose: str) -> Decorator:
    """Add --px4-version: of the simulated autopilot; None where it is not given."""
    return together(
        option(
            "--px4-version",
            type=Parsed(_px4_version),
            metavar="VERSION",
            help=f"version of PX4 that {purpose}: {_VERSIONS} (default {name_of(NEWEST)})",
        ),
    )
