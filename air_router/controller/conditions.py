"""Whether satellites and wind are as the mission is planned for: what they are not, is held for.

Routes keep so much more than the clearance as the vehicle may be off them at the speed, in the wind
and with the accuracy of the mission file (`mission.tracking`). Where it may be farther off than
that the clearance is not sure any more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from air_router.controller.limits import CONDITIONS_GOOD_S, CONDITIONS_HOME_S, CONDITIONS_WORSE_S
from air_router.controller.model import Anomaly, MissionContext, Signal
from air_router.controller.safety_monitor import Deviation, Response
from air_router.mission import SLACK_M, tracking_error_m
from air_router.vehicle import CLEARANCE_UNCERTAIN, Telemetry


@dataclass(slots=True, eq=False)
class ConditionsWatch:
    """Checks every telemetry update of a vehicle that flies its mission by our commands.

    Args:
        context: What was planned for.

    Attributes:
        waits: They are, or may be, worse: they need checking though nothing shows.
    """

    _context: MissionContext
    waits: bool = False
    _held: bool = False  # it holds for them
    _worse_since_s: float | None = None
    _good_since_s: float | None = None  # while it is off: good again since
    _off_since_s: float | None = None  # when it was announced; inf: and the vehicle comes home

    def update(self, telemetry: Telemetry) -> Deviation | None:
        """Whether they are worse than planned for, as planned again, or worse for too long."""
        now_s, worse = telemetry.time_s, self._worse(telemetry)
        comes_home = not self._context.knows(Signal.COME_HOME)
        if self._off_since_s is not None and comes_home and self._held:
            # For its battery, perhaps, or on request: it is not held for any more.
            self._off_since_s, self._held = math.inf, False
            return Deviation(Response.BACK, "", None, anomaly=Anomaly.CONDITIONS)
        if self._off_since_s is not None:
            return self._while_off(worse, now_s, self._off_since_s)
        self.waits = worse is not None
        if worse is None:
            self._worse_since_s = None
            return None
        if self._worse_since_s is None:
            self._worse_since_s = now_s
        if now_s - self._worse_since_s < CONDITIONS_WORSE_S:
            return None
        self._off_since_s, self._good_since_s = now_s, None
        if comes_home:  # which is what it would do
            self._off_since_s = math.inf
            return Deviation(Response.ANNOUNCE, worse, CLEARANCE_UNCERTAIN)
        self._held = True
        return Deviation(Response.WAIT, worse, CLEARANCE_UNCERTAIN, anomaly=Anomaly.CONDITIONS)

    def _while_off(self, worse: str | None, now_s: float, off_since_s: float) -> Deviation | None:
        if worse is None:
            if self._good_since_s is None:
                self._good_since_s = now_s
            if now_s - self._good_since_s < CONDITIONS_GOOD_S:
                return None
            response = Response.BACK if self._held else Response.ANNOUNCE
            self.forget()
            words = "satellites and wind are as planned for again"
            return Deviation(response, words, None, anomaly=Anomaly.CONDITIONS)
        self._good_since_s = None
        if now_s - off_since_s < CONDITIONS_HOME_S:
            return None
        self._off_since_s, self._held = math.inf, False  # once, until they are good again
        return Deviation(Response.HOME, worse, CLEARANCE_UNCERTAIN, anomaly=Anomaly.CONDITIONS)

    def _worse(self, telemetry: Telemetry) -> str | None:
        """What is worse than planned for, as text; None: the vehicle is no farther off by it."""
        mission = self._context.airspace.mission
        planner, limit_m = mission.planner, mission.tracking.flown_m + SLACK_M
        wind_m_s, accuracy_m = planner.wind_m_s, planner.position_accuracy_m
        if telemetry.wind_m_s is not None:
            wind_m_s = math.hypot(*telemetry.wind_m_s)
        if telemetry.accuracy_m is not None:
            accuracy_m = telemetry.accuracy_m
        if tracking_error_m(mission.speed_m_s, wind_m_s, accuracy_m) <= limit_m:
            return None
        if accuracy_m > planner.position_accuracy_m:
            planned_m = f"{planner.position_accuracy_m:g} m are planned for"
            return f"the satellites' position is good to {accuracy_m:.1f} m only, {planned_m}"
        return f"wind of {wind_m_s:.0f} m/s, {planner.wind_m_s:g} m/s are planned for"

    def forget(self) -> None:
        """They are good again, or it does not fly its mission by our commands just now."""
        self.waits = self._held = False
        self._worse_since_s = self._good_since_s = self._off_since_s = None
