"""Gives one order to a real MAVSDK vehicle whose PX4 does what a test scripts."""

import asyncio
import contextlib

import pytest

from air_router.mission.loading import load_mission
from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.px4 import px4_commands
from air_router.vehicle.px4.px4 import Px4Vehicle
from air_router.vehicle.vehicle import FlightMode
from tests.system.orders.verbs import ELSEWHERE
from tests.system.scripted_px4 import (
    GROUND,
    HOLD,
    MISSION,
    ScriptedPx4,
)

LIMIT_S = 60


@pytest.fixture
def mission(short_mission):
    return load_mission(short_mission)


@pytest.fixture
def patient(monkeypatch):
    """A test in which something was waited for to the end does not end."""
    monkeypatch.setattr(px4_commands, "ORDER_CONFIRM_S", 2.0 * LIMIT_S)
    monkeypatch.setattr(px4_commands, "ORDER_LONGEST_S", 2.0 * LIMIT_S)


@pytest.fixture
def run(mission, udp_port):
    """Runs `script(vehicle, px4)` against a vehicle that does `answer(px4, order)`."""

    def degrees(point):
        return mission.frame.to_geodetic(point)

    def start(answer, script, keep=None, version=(1, 17), **state):
        px4 = ScriptedPx4(udp_port, degrees(mission.home), answer, version)
        px4.places = degrees
        if keep is not None:
            keep.append(px4)

        async def main():
            vehicle = Px4Vehicle(mission, f"udpin://127.0.0.1:{udp_port}", VehicleClock())
            try:
                async with asyncio.timeout(LIMIT_S):
                    await vehicle.connect()
                    for name, value in state.items():
                        setattr(px4, name, value)
                    assert await vehicle.telemetry.shows(
                        lambda: seen(vehicle.telemetry, px4), LIMIT_S
                    )
                    await script(vehicle)
            finally:
                await vehicle.close()

        with contextlib.closing(px4):
            asyncio.run(main())
        return px4

    return start


def seen(telemetry, px4):
    modes = {HOLD: FlightMode.HOLD, MISSION: FlightMode.MISSION}
    target = px4.target is None or telemetry.target is not None
    return (
        telemetry.mode is modes[px4.mode]
        and telemetry.armed == px4.armed
        and telemetry.item == px4.item
        and telemetry.in_air == (px4.landed != GROUND)
        and target
    )


@pytest.fixture
def hovering(mission):
    """A vehicle in Hold that reports where it hovers."""
    return {"mode": HOLD, "target": mission.frame.to_geodetic(ELSEWHERE)}
