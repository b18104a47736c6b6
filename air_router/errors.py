"""The errors of air_router: one class per cause, each with the exit code it ends a command with.

Exit codes: 0 done, 1 ended otherwise, 2 usage, 3 invalid file, 4 no vehicle, 5 refused before
take-off, 6 the pilot took over, 130 interrupted.
"""

from __future__ import annotations

from typing import ClassVar


class AirRouterError(Exception):
    """Anything that air_router reports: the message says what, where, and what to do."""

    exit_code: ClassVar[int] = 1


class NoVehicleError(AirRouterError):
    """No autopilot that we can fly answers on the connection."""

    exit_code = 4


class RefusedError(AirRouterError):
    """The flight does not start; nothing has moved."""

    exit_code = 5


class PlanRefusedError(RefusedError):
    """The vehicle did not take the plan or its fence, or gave back another than was sent."""


class ArmingRefusedError(RefusedError):
    """The autopilot does not arm."""


class NotConfirmedError(AirRouterError):
    """A command was sent and the vehicle did not follow it."""
