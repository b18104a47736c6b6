"""The setup of a flight, as it is recorded; `Controller` is made from it."""

from __future__ import annotations

from dataclasses import dataclass

from air_router.mission import Mission


@dataclass(frozen=True, slots=True)
class FlightSetup:
    """One flight's mission and how it is flown.

    Attributes:
        mission: The validated mission, with the zones that applied at that time.
        seek: The robots to seek, in order.
        pilot_arms: The pilot arms. If the vehicle is disarmed again on the ground, the mission
            waits.
        explore: Explore between two searches; else only search.
        name: The UAV's name in the team. Of two UAVs that seek the same robot, the lower name keeps
            it.
    """

    mission: Mission
    seek: tuple[str, ...] = ()
    pilot_arms: bool = False
    explore: bool = True
    name: str = ""
