import pytest

from air_router.vehicle.px4.px4_mode import flight_mode
from air_router.vehicle.vehicle import FlightMode

# HEARTBEAT.custom_mode as captured from PX4 1.17: main mode in byte 2, sub mode in byte 3.
CAPTURED = {
    0x03040000: FlightMode.HOLD,
    0x04040000: FlightMode.MISSION,
    0x02040000: FlightMode.TAKEOFF,
    0x05040000: FlightMode.RETURN,
    0x06040000: FlightMode.LAND,
    0x00030000: FlightMode.POSITION,
    0x01030000: FlightMode.OTHER,  # Orbit
    0x00020000: FlightMode.ALTITUDE,
    0x00060000: FlightMode.OTHER,  # Offboard
    0x08040000: FlightMode.OTHER,  # Follow me
    0: FlightMode.OTHER,
}


@pytest.mark.parametrize(("custom_mode", "mode"), list(CAPTURED.items()))
def test_custom_modes(custom_mode, mode):
    assert flight_mode(custom_mode) is mode
