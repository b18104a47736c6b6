"""The tree of errors that end a command: one class per cause, each knows its exit code."""

from enum import IntEnum
from typing import ClassVar

from mocha_link.errors import MISSING_EXTRA, MissingExtraError, MochaLinkError, RequestError
from mocha_link.team import DocumentError


class ExitCode(IntEnum):
    """The exit codes of `air-router` commands."""

    DONE = 0
    ENDED_OTHERWISE = 1
    USAGE = 2
    INVALID_FILE = 3
    NO_VEHICLE = 4
    REFUSED = 5
    PILOT_TOOK_OVER = 6
    MISSING_EXTRA = MISSING_EXTRA
    INTERRUPTED = 130


class AirRouterError(Exception):
    """Something that ends a command; the message says what, where, and what to do."""

    exit_code: ClassVar[ExitCode] = ExitCode.ENDED_OTHERWISE


class UsageError(AirRouterError):
    """The command line requests something that the mission does not have."""

    exit_code = ExitCode.USAGE


class PictureError(AirRouterError):
    """A picture cannot be drawn or written."""


class NoVehicleError(AirRouterError):
    """No autopilot that we can fly answers on the connection."""

    exit_code = ExitCode.NO_VEHICLE


class RefusedError(AirRouterError):
    """The flight is not started or resumed; this program has not moved the vehicle."""

    exit_code = ExitCode.REFUSED


class PlanRefusedError(RefusedError):
    """The plan is not on board as it should be, or cannot be flown.

    PX4 did not accept it, finds it infeasible, or returns another than was sent; another station
    has changed it; or it was not sent, because no current flight mode was received or there is an
    objection.
    """


class PlanKeptError(PlanRefusedError):
    """A plan was refused before anything was sent: the one on board is as it was."""


class ArmingRefusedError(RefusedError):
    """The vehicle is not armed or not started.

    The autopilot refuses, or the pilot has armed or disarmed it, or chosen a mode.
    """


class NotConfirmedError(AirRouterError):
    """The vehicle did not confirm a command: it does not follow it, or it was not sent."""


class NotSentError(NotConfirmedError):
    """A command was not sent.

    No current flight mode was received, a failsafe acts, or there is an objection.
    """


EXPECTED = (AirRouterError, MochaLinkError, OSError)
"""What ends a command with one message; anything else is a fault of ours."""


def exit_code(error: Exception) -> ExitCode:
    """The exit code of an expected error."""
    if isinstance(error, AirRouterError):
        return error.exit_code
    if isinstance(error, DocumentError):
        return ExitCode.INVALID_FILE
    if isinstance(error, RequestError):
        return ExitCode.USAGE
    if isinstance(error, MissingExtraError):
        return ExitCode.MISSING_EXTRA
    return ExitCode.ENDED_OTHERWISE
