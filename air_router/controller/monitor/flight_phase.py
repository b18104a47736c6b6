"""How a mission gets off the ground, and how a flight counts as over: what telemetry has shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from air_router.vehicle.vehicle import FlightMode, Telemetry

DISARMED_S: Final = 10.0
"""A landed vehicle of which no HEARTBEAT has come for so long counts as disarmed."""

CLIMB_S: Final = 20.0
KILLED_M: Final = 3.0
"""Disarmed in the air lower than this it has landed, for all that an altitude above home tells."""

REST_M: Final = 0.5
REST_S: Final = 2.0
"""What fell is down when its altitude has changed by less than this in that time."""

PROGRESS_M: Final = 0.5
"""A climb that gains less than this in that time does not go on; PX4 takes off at 1.5 m/s."""


@dataclass(slots=True)
class FlightPhase:
    """What has been seen of arming, lift-off and touch-down.

    Attributes:
        handed_over: Armed in Mission mode: the pilot who did that gave the flight to us.
        airborne_s: When the mission began in the air, on the vehicle's clock.
        killed: Where its motors were stopped in the air, in words, if they were.
        stayed_why: Why it ended before take-off, if it does.
    """

    handed_over: bool = False
    airborne_s: float | None = None
    killed: str | None = None
    stayed_why: str = "disarmed"
    _flew: bool = False
    _was_armed: bool = False
    _flies: bool = False
    _news: bool = False
    _rest: tuple[float, float] = (0.0, 0.0)
    _highest: tuple[float, float] | None = None

    def note(self, telemetry: Telemetry) -> bool:
        """Take in what the vehicle says of itself; True when it is handed over to us just now."""
        self._fall(telemetry)
        self._flew |= telemetry.in_air
        self._was_armed |= telemetry.armed
        before = self.handed_over
        self.handed_over |= telemetry.armed and telemetry.mode is FlightMode.MISSION
        return self.handed_over and not before

    def _fall(self, telemetry: Telemetry) -> None:
        """PX4 says of a vehicle that was disarmed in the air within a second that it has landed."""
        motors = telemetry.armed and not telemetry.terminated
        if self._flies and not motors and telemetry.altitude_m > KILLED_M:
            how = "flight terminated" if telemetry.armed else "disarmed"
            self.killed = f"{how} in the air at {telemetry.altitude_m:.0f} m above home"
            self._news = True
            self._rest = (telemetry.altitude_m, telemetry.time_s)
        elif motors and telemetry.in_air:
            self.killed = None  # and it flies again
        elif abs(telemetry.altitude_m - self._rest[0]) >= REST_M:
            self._rest = (telemetry.altitude_m, telemetry.time_s)
        self._flies = motors and telemetry.in_air

    def killed_now(self) -> str | None:
        """Where its motors were stopped in the air, in words; says so once."""
        news, self._news = self._news, False
        return self.killed if news else None

    def over(self, telemetry: Telemetry) -> bool:
        """Whether it is disarmed after having been armed: then it is down, unless it falls.

        Where no HEARTBEAT tells it any more, what is on the ground after a flight is disarmed.
        """
        if self.killed is not None:
            down = telemetry.told_s - self._rest[1] >= REST_S
            return down and not telemetry.armed
        if telemetry.ages.armed_s >= DISARMED_S and self._flew:
            return not telemetry.in_air
        return self._was_armed and not telemetry.armed

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
        if self.killed is not None:
            return self.killed
        if landed_by_us:
            return "landed at home"
        if self._flew:
            return "landed, but not by our command"
        return f"{self.stayed_why}, before take-off"
