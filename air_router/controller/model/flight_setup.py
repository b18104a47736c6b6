"""What a flight is decided with, as it is recorded; `Controller` is put together from it."""

from __future__ import annotations

from dataclasses import dataclass

from air_router.mission import Mission


@dataclass(frozen=True, slots=True)
class FlightSetup:
    """One flight's mission and how it is flown.

    Attributes:
        mission: What to fly, as it was judged: with the zones that applied at that time.
        seek: The robots to seek, in order.
        pilot_arms: The pilot arms: if it is disarmed again on the ground, wait on.
        explore: Explore between two searches; otherwise only search.
        name: The UAV's name in the team: of two that seek the same robot, the lower name keeps it.
    """

    mission: Mission
    seek: tuple[str, ...] = ()
    pilot_arms: bool = False
    explore: bool = True
    name: str = ""
