"""How a mission gets off the ground, and how a flight counts as over: what telemetry has shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from air_router.vehicle import FlightMode

if TYPE_CHECKING:
    from air_router.vehicle import Telemetry

CLIMB_S: Final = 20.0
PROGRESS_M: Final = 0.5
"""A climb that gains less than this in that time does not go on; PX4 takes off at 1.5 m/s."""


@dataclass(slots=True)
class Launch:
    """What has been seen of arming, lift-off and touch-down.

    Attributes:
        handed_over: Armed in Mission mode: whoever did that gave the flight to us.
        airborne_s: When the mission began in the air, on the vehicle's clock.
        stayed_why: Why it ended before take-off, if it does.
    """

    handed_over: bool = False
    airborne_s: float | None = None
    stayed_why: str = "disarmed"
    _flew: bool = False
    _was_armed: bool = False
    _highest: tuple[float, float] | None = None

    def note(self, telemetry: Telemetry) -> bool:
        """Take in what the vehicle says of itself; True when it is handed over to us just now."""
        self._flew |= telemetry.in_air
        self._was_armed |= telemetry.armed
        before = self.handed_over
        self.handed_over |= telemetry.armed and telemetry.mode is FlightMode.MISSION
        return self.handed_over and not before

    def over(self, telemetry: Telemetry) -> bool:
        """Whether the vehicle is down and disarmed after having been armed."""
        return self._was_armed and not telemetry.armed and not telemetry.in_air

    def again(self) -> bool:
        """Whether it was only armed and disarmed again; then everything begins anew."""
        if self._flew:
            return False
        self.handed_over = self._was_armed = False
        self._highest = None
        return True

    def resumed(self, now_s: float) -> None:
        """A flight that was under way before us, or given away, is ours from now on."""
        self.handed_over = True
        if self.airborne_s is None:
            self.airborne_s = now_s

    def stuck(self, telemetry: Telemetry) -> bool:
        """Whether the climb that was handed over to us has not gone on for some time."""
        if not (self.handed_over and telemetry.in_air):
            return False
        if self._highest is None or telemetry.altitude_m > self._highest[0] + PROGRESS_M:
            self._highest = (telemetry.altitude_m, telemetry.time_s)
        return telemetry.time_s - self._highest[1] >= CLIMB_S

    def since_s(self, now_s: float) -> float:
        """How long the mission has been in the air."""
        return 0.0 if self.airborne_s is None else now_s - self.airborne_s

    def ending(self, *, landed_by_us: bool) -> str:
        """How it ended, in words."""
        if landed_by_us:
            return "landed at home"
        if self._flew:
            return "landed, but not by our command"
        return f"{self.stayed_why}, before take-off"
