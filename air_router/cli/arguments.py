"""Arguments and output that several commands share."""

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
    """Print the object of `--json` on one line, unbuffered."""
    json.dump(facts, sys.stdout)
    sys.stdout.write("\n")
    sys.stdout.flush()


def say(text: str) -> None:
    """Print a line for the operator on stderr, unbuffered."""
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
    """The parser of a number from `lowest` to `highest`.

    Args:
        what: Describes the number in the error message: "a speed between 0.1 and 100".
        lowest: The smallest value; `MORE_THAN_0` to exclude 0.
        highest: The largest value; `ANY_FINITE` for no limit.
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
    """Print notes on options with unusual values.

    Args:
        arguments: The command line.
        fields: By argument name, the option's field in `usual_values`.
    """
    from air_router.files import option_notes  # noqa: PLC0415 - few commands need it

    given = ((f"--{name}", getattr(arguments, name), field) for name, field in fields.items())
    for note in option_notes(given):
        say(note)


_FIRST_YEAR, _LAST_YEAR = 1970, 9000  # of flights; leaves room for arithmetic with times

MORE_THAN_0, ANY_FINITE = sys.float_info.min, sys.float_info.max
speed_factor = number("a speed between 0.1 and 100", 0.1, 100.0)
"""Parser of the speed of a simulation or playback, times real time."""


def place(text: str) -> Geodetic:
    """Parse LAT,LON in degrees.

    Raises:
        ValueError: The text is not a position.
    """
    try:
        latitude_deg, longitude_deg = map(float, text.split(","))
    except ValueError:
        message = f"{text} is not LATITUDE,LONGITUDE{_place_advice(text)}"
        raise ValueError(message) from None
    return Geodetic(latitude_deg, longitude_deg)


def _place_advice(text: str) -> str:
    """Advice for a text that is not a position, after a semicolon; may be empty."""
    halves = [decimal_degrees(plain(half)) for half in text.split(",")]
    if pair := pair_in(text.strip()):
        return f"; write {pair.strip('[]').replace(' ', '')}"
    if len(halves) == 2 and all(halves):
        return f"; write decimal degrees: {','.join(map(str, halves))}"
    if "," not in text:
        return "; write both as one argument, with a comma and no blank"
    return ""


def home(text: str) -> Geodetic:
    """Parse the LAT,LON of a home in degrees.

    Raises:
        ValueError: The text is not a position on Earth.
    """
    given = place(text)
    try:
        return LocalFrame(given).origin
    except FrameError as error:
        raise ValueError(f"{text}: {error}") from None


def moment(text: str) -> datetime:
    """Parse a time with its time zone.

    Raises:
        ValueError: The text is not a time, or outside the supported years.
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
    help="start time of the mission, e.g. 2026-11-20T08:00:00Z (default: now), for zones with "
    "hours",
)
"""Add `--at`: the start time, for zones that do not apply at all times."""


uav_option = option(
    "--uav",
    metavar="NAME",
    help="UAV to use, if the mission file has several (`uavs`)",
)
"""Add `--uav`: the UAV to use of a mission for several."""


rover_option = option(
    "--rover",
    multiple=True,
    type=Parsed(_rover),
    metavar="NAME=ENDPOINT",
    help="run robot NAME by a program of your own: the simulation serves the robot's node at "
    "ENDPOINT, and the program publishes the position, e.g. rover=ipc:///tmp/rover "
    "(docs/robot.md); may be repeated",
)
"""Add `--rover`: robots of a simulation that the user's own programs run."""


def px4_version_option(purpose: str) -> Decorator:
    """Add --px4-version, of the simulated autopilot; None if not given."""
    return together(
        option(
            "--px4-version",
            type=Parsed(_px4_version),
            metavar="VERSION",
            help=f"version of PX4 that {purpose}: {_VERSIONS} (default {name_of(NEWEST)})",
        ),
    )
