"""What the flight modes decide on: the vehicle as its autopilot believes it to be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from sitl.px4sim.motion.guidance import MaxSpeeds, Pace, Setpoint
from sitl.px4sim.motion.projection import MapProjection
from sitl.px4sim.state.notice import Notice, Severity
from sitl.px4sim.state.parameters import Parameters
from sitl.px4sim.state.px4_modes import FlightMode


@dataclass(frozen=True, slots=True)
class Place:
    """Where the vehicle is started: WGS-84 degrees, metres AMSL."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


@dataclass(slots=True)
class Situation:
    """The autopilot's knowledge at one moment; it renews the numbers every step.

    Attributes:
        projection: Degrees to local metres and back.
        parameters: On board.
        ask_mode: Lets a mission or a finished mode ask for another mode.
        time_s: Since start.
        north_m: Estimated.
        east_m: Estimated.
        altitude_m: Estimated, AMSL.
        velocity_m_s: North, east, up.
        heading_rad: Of the nose.
        position_valid: Whether the position is good enough to fly by.
        landed: Whether it stands on the ground.
        took_off_s: When it took off since it was armed; None if it has not.
        armed: Whether the motors turn.
        home: North, east in metres, once set.
        home_altitude_m: AMSL; wanders in flight.
        ground_altitude_m: AMSL, of the flat ground.
        speed_m_s: Cruise speed that was asked for in this mode; None: MPC_XY_CRUISE.
        setpoint: What is flown to.
        notices: Said and not yet sent.
    """

    projection: MapProjection
    parameters: Parameters
    ask_mode: Callable[[FlightMode], object]
    ground_altitude_m: float
    time_s: float = 0.0
    north_m: float = 0.0
    east_m: float = 0.0
    altitude_m: float = 0.0
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading_rad: float = 0.0
    position_valid: bool = True
    landed: bool = True
    took_off_s: float | None = None
    armed: bool = False
    home: tuple[float, float] | None = None
    home_altitude_m: float = 0.0
    speed_m_s: float | None = None
    setpoint: Setpoint = field(default_factory=Setpoint)
    notices: list[Notice] = field(default_factory=list)

    @property
    def cruise_m_s(self) -> float:
        """The speed to fly with, within what the vehicle can do."""
        wanted = self.parameters["MPC_XY_CRUISE"] if self.speed_m_s is None else self.speed_m_s
        return max(0.1, min(wanted, self.parameters.limited("MPC_XY_VEL_MAX", 0.1, 20.0)))

    @property
    def acceptance_m(self) -> float:
        """NAV_ACC_RAD."""
        return self.parameters.limited("NAV_ACC_RAD", 0.05, 200.0)

    @property
    def altitude_acceptance_m(self) -> float:
        """NAV_MC_ALT_RAD."""
        return self.parameters.limited("NAV_MC_ALT_RAD", 0.05, 200.0)

    def pace(self) -> Pace:
        """Speed limits of this moment's parameters."""
        limited = self.parameters.limited
        return Pace(
            limited("MPC_Z_V_AUTO_UP", 0.5, 8.0),
            limited("MPC_Z_V_AUTO_DN", 0.5, 4.0),
            limited("MPC_TKO_SPEED", 0.5, 5.0),
            limited("MPC_LAND_SPEED", 0.4, 4.0),
            limited("MPC_ACC_HOR", 2.0, 15.0),
            limited("MPC_JERK_AUTO", 1.0, 80.0),
            MaxSpeeds(
                limited("MPC_XY_VEL_MAX", 0.1, 20.0),
                limited("MPC_Z_VEL_MAX_UP", 0.5, 8.0),
                limited("MPC_Z_VEL_MAX_DN", 0.5, 4.0),
            ),
        )

    def say(
        self,
        text: str,
        event: str = "",
        severity: Severity = Severity.INFO,
        event_severity: Severity | None = None,
        arguments: bytes = b"",
    ) -> None:
        """Tell the outside world; see `Notice`."""
        self.notices.append(Notice(severity, text, event, event_severity, arguments))
