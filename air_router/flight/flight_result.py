"""How a flight ended, for the program that started it."""

from __future__ import annotations

from dataclasses import dataclass

from air_router.controller.model.actions import ControlHolder, Finish
from air_router.errors import ExitCode
from geo.frame import Point


@dataclass(frozen=True, slots=True)
class FlightResult:
    """How a flight ended.

    Attributes:
        report: What `--json` prints.
        track: Where the vehicle was, in the mission's metres.
        meetings: Whom it found, and where it was then.
    """

    outcome: str  # in words
    exit_code: ExitCode
    report: dict[str, object]
    track: tuple[Point, ...]
    meetings: tuple[tuple[str, Point], ...] = ()


def ending_of(finish: Finish) -> tuple[str, ExitCode]:
    """The outcome in words, and the exit code, of a flight that the controller has finished."""
    match finish:
        case Finish(landed_by_us=True):
            return "done", ExitCode.DONE
        case Finish(taken_by=ControlHolder.PILOT):
            return "pilot", ExitCode.PILOT_TOOK_OVER
        case Finish(taken_by=ControlHolder.FAILSAFE):
            return "failsafe", ExitCode.ENDED_OTHERWISE
        case _:
            return f"ended: {finish.why}", ExitCode.ENDED_OTHERWISE
