"""The simulated autopilot's MAVLink: links, streams, microservices."""

from mocha_link.errors import needs_extra

with needs_extra("the simulator", "sim", "air-router"):
    import pymavlink  # noqa: F401 - checked here once, for every part that uses MAVLink

from sitl.mavlink.codec import Frame, Sender, addressed, command_number, frames
from sitl.mavlink.link import MavlinkLink
from sitl.mavlink.telemetry import ONBOARD_RATES_HZ
from sitl.mavlink.vehicle import MavlinkVehicle, VehicleSettings

__all__ = [
    "ONBOARD_RATES_HZ",
    "Frame",
    "MavlinkLink",
    "MavlinkVehicle",
    "Sender",
    "VehicleSettings",
    "addressed",
    "command_number",
    "frames",
]
