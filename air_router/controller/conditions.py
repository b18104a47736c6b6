"""Checks satellite accuracy and wind against the plan; the vehicle holds while they are worse.

Routes add a tracking margin to the clearance, for the speed, wind and accuracy in the mission file
(`mission.tracking`). If the vehicle may be farther off its route than that, the clearance is no
longer certain.
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
    """Checks every telemetry update of a vehicle that flies its mission.

    Args:
        context: The mission with its planned conditions.

    Attributes:
        waits: The conditions are or may be worse, so `update` must be called.
    """

    _context: MissionContext
    waits: bool = False
    _held: bool = False  # the vehicle holds for them
    _worse_since_s: float | None = None  # worse than planned since, not yet announced
    _good_since_s: float | None = None  # good again since, after being worse
    _off_since_s: float | None = None  # time of the announcement; inf: the vehicle comes home

    def update(self, telemetry: Telemetry) -> Deviation | None:
        """The deviation when conditions get worse than planned, recover, or stay worse too long."""
        now_s, worse = telemetry.time_s, self._worse(telemetry)
        comes_home = not self._context.knows(Signal.COME_HOME)
        if self._off_since_s is not None and comes_home and self._held:
            # It comes home, for its battery or on request: no more holding.
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
        if comes_home:  # it does so already
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
            words = "GPS accuracy and wind are as planned again"
            return Deviation(response, words, None, anomaly=Anomaly.CONDITIONS)
        self._good_since_s = None
        if now_s - off_since_s < CONDITIONS_HOME_S:
            return None
        self._off_since_s, self._held = math.inf, False  # only once, until they are good again
        return Deviation(Response.HOME, worse, CLEARANCE_UNCERTAIN, anomaly=Anomaly.CONDITIONS)

    def _worse(self, telemetry: Telemetry) -> str | None:
        """The worse condition, as text; None: the tracking error is within the plan."""
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
            planned_m = f"planned for {planner.position_accuracy_m:g} m"
            return f"the satellites' position is good to {accuracy_m:.1f} m only, {planned_m}"
        return f"wind of {wind_m_s:.0f} m/s, planned for {planner.wind_m_s:g} m/s"

    def forget(self) -> None:
        """Reset: conditions are good again, or the vehicle does not fly its mission now."""
        self.waits = self._held = False
        self._worse_since_s = self._good_since_s = self._off_since_s = None
