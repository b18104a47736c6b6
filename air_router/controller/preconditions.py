"""Whether the vehicle may be told anything just now."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from air_router.controller.control_authority import ControlAuthority
from air_router.controller.model.actions import Refusal
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.states import Requests
from air_router.controller.states.goto_state import Refused
from air_router.controller.states.return_state import ReturnState
from air_router.vehicle.input_limits import InputWatch

NOT_HEARD_S: Final = 3.0
"""A vehicle that was not heard for so long is not sent anywhere: its position is unknown."""


@dataclass(slots=True, eq=False)
class Preconditions:
    """Looks at a request before what is asked for is looked at; None: nothing stands against it.

    Args:
        context: What the mission is doing, and when the vehicle was heard.
        inputs: Whether it has a position, and whose it is.
        return_state: Whether a way home may be called off.
        authority: Whose it is, and for how long.
    """

    _context: MissionContext
    _inputs: InputWatch
    _return_state: ReturnState
    _authority: ControlAuthority

    def to_stop(self) -> Refused | None:
        """It is ours, in the air, and not on a way home that may not be called off.

        A way home is only called off if it was requested, and nothing else demands it.
        """
        requests = self._context.spec.requests
        if self._authority.giving_up is not None:
            return self.to_decide()
        if requests is Requests.CALL_OFF:
            why = self._return_state.objection()
            return None if why is None else comes_home(why)
        return None if requests is Requests.ANY else self.in_the_air()

    def to_move(self) -> Refused | None:
        """And beside that it is known where it is."""
        return self.to_stop() or self.without_position()

    def without_position(self) -> Refused | None:
        """It is known where it is: legs are checked from there."""
        telemetry = self._context.heard
        missing = self._inputs.why_no_leg(telemetry)
        if missing is not None:
            return Refused(Refusal.NOT_HEARD if telemetry.fix else Refusal.NO_FIX, missing)
        return self.not_heard()

    def not_heard(self) -> Refused | None:
        """It was heard just now."""
        telemetry = self._context.heard
        # Its clock stands still while nothing is heard of it: then the link says for how long.
        silent_s = max(self._context.now_s - telemetry.time_s, self._context.silent_s)
        if silent_s <= NOT_HEARD_S:
            return None
        what = "no position" if telemetry.told_s > telemetry.time_s else "nothing"
        return Refused(Refusal.NOT_HEARD, f"{what} heard from it for {silent_s:.0f} s")

    def to_decide(self) -> Refused | None:
        """It is not about to be given away."""
        why = self._authority.giving_up
        if why is None:
            return None
        return Refused(Refusal.HANDS_OFF, f"hands off in a moment: {why}")

    def in_the_air(self) -> Refused | None:
        """It flies this mission."""
        requests = self._context.spec.requests
        if requests is Requests.NOT_YET:
            return Refused(Refusal.NOT_FLYING, requests.value)
        if requests is Requests.OVER:
            return Refused(Refusal.FLIGHT_OVER, requests.value)
        if requests is Requests.NOT_OURS:
            taker = self._authority.taken_by
            who = taker.value if taker else "the pilot"
            return Refused(Refusal.NOT_OURS, f"{who} has the vehicle; {self._authority.way_back}")
        return None


def comes_home(why: str | None) -> Refused:
    """A request or a trigger had it come home, and that counts."""
    return Refused(Refusal.COMING_HOME, f"it comes home: {why}")
