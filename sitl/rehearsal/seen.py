"""What there is to be seen of a simulated flight: the vehicle's true state, and its phases."""

from __future__ import annotations

from sitl.px4sim.autopilot import Autopilot
from sitl.rehearsal.companion import Companion
from sitl.rehearsal.judge.evidence import Sample


def true_degrees(autopilot: Autopilot) -> tuple[float, float]:
    """Where the vehicle really is: latitude and longitude."""
    airframe = autopilot.airframe
    return autopilot.situation.projection.to_global(airframe.north_m, airframe.east_m)


def true_state(autopilot: Autopilot, now_s: float) -> Sample:
    """The vehicle as it really is at a simulated time."""
    return Sample(
        now_s,
        *true_degrees(autopilot),
        autopilot.place.altitude_m + autopilot.airframe.up_m,
        autopilot.armed,
        autopilot.airframe.on_ground,
        autopilot.mode.custom_mode,
        autopilot.failsafe.acting,
    )


def phases(autopilot: Autopilot, companion: Companion | None) -> list[str]:
    """The phases of its flight that a vehicle is in, by the words of `faults.PHASES`."""
    found = ["armed"] if autopilot.armed else []
    if autopilot.taking_off:
        found.append("climb")
    if autopilot.landing:
        found.append("landing")
    if companion is not None:
        found.append(companion.flight.controller.state.name)
    return found
