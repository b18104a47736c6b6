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
    """The flight does not start; nothing has moved."""

    exit_code = ExitCode.REFUSED


class PlanRefusedError(RefusedError):
    """The vehicle did not take the plan or its fence, or gave back another than was sent."""


class PlanKeptError(PlanRefusedError):
    """A plan was refused before anything was sent: the one on board is as it was."""


class ArmingRefusedError(RefusedError):
    """The autopilot does not arm."""


class NotConfirmedError(AirRouterError):
    """A command was sent and the vehicle did not follow it."""


class NotSentError(NotConfirmedError):
    """A command was not sent: the vehicle's flight mode of this moment was not received."""


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
