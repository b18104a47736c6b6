"""The messages that the autopilot streams: which ones, how often, and what is in them.

Rates are PX4 1.17's on its SITL links, in simulated hertz, but ATTITUDE (50 instead of 100) and
those that are left out because no pilot flies by them: SCALED_PRESSURE, VIBRATION, DISTANCE_SENSOR,
GNSS_INTEGRITY, Remote ID and the like.
"""

from __future__ import annotations

from typing import Final

from sitl.mavlink.control_messages import ControlMessages
from sitl.mavlink.position_messages import PositionMessages
from sitl.mavlink.status_messages import StatusMessages
from sitl.px4sim.autopilot import Autopilot
from sitl.px4sim.state.outgoing import Outgoing
from sitl.px4sim.state.px4_version import Px4Version

ONBOARD_RATES_HZ: Final[dict[str, float]] = {
    "HEARTBEAT": 1.0,
    "SYS_STATUS": 5.0,
    "SYSTEM_TIME": 1.0,
    "GPS_RAW_INT": 8.0,
    "ATTITUDE": 50.0,
    "ATTITUDE_QUATERNION": 50.0,
    "LOCAL_POSITION_NED": 30.0,
    "GLOBAL_POSITION_INT": 50.0,
    "VFR_HUD": 10.0,
    "TIMESYNC": 10.0,
    "ALTITUDE": 10.0,
    "BATTERY_STATUS": 0.5,
    "ESTIMATOR_STATUS": 1.0,
    "HOME_POSITION": 0.5,
    "EXTENDED_SYS_STATE": 5.0,
    "CURRENT_EVENT_SEQUENCE": 1.0 / 3.0,
    "CURRENT_MODE": 0.5,
    "POSITION_TARGET_LOCAL_NED": 10.0,
    "POSITION_TARGET_GLOBAL_INT": 10.0,
    "SERVO_OUTPUT_RAW": 10.0,
    "ODOMETRY": 30.0,
    "HIGHRES_IMU": 50.0,
    "WIND_COV": 10.0,
}
_ONBOARD_ONLY: Final = {"ODOMETRY", "HIGHRES_IMU", "TIMESYNC", "SYSTEM_TIME"}
GROUND_RATES_HZ: Final[dict[str, float]] = {
    name: rate for name, rate in ONBOARD_RATES_HZ.items() if name not in _ONBOARD_ONLY
} | {
    "SYS_STATUS": 1.0,
    "GPS_RAW_INT": 5.0,
    "LOCAL_POSITION_NED": 50.0,
    "VFR_HUD": 4.0,
    "ALTITUDE": 1.0,
    "EXTENDED_SYS_STATE": 1.0,
    "POSITION_TARGET_LOCAL_NED": 50.0,
    "SERVO_OUTPUT_RAW": 50.0,
    "WIND_COV": 0.5,
}
TRUTH_RATES_HZ: Final[dict[str, float]] = {"HEARTBEAT": 1.0, "HIL_STATE_QUATERNION": 25.0}


class Telemetry:
    """All messages that can be streamed or asked for.

    Attributes:
        status: Builder of the status messages, which also knows the time.
        version: What PX4 it is.
    """

    def __init__(self, autopilot: Autopilot, start_unix_s: float, version: Px4Version) -> None:
        self.version = version
        self.status = StatusMessages(autopilot, start_unix_s, version.number)
        self._builders = (
            self.status.builders()
            | PositionMessages(autopilot).builders()
            | ControlMessages(autopilot).builders()
        )

    def knows(self, name: str) -> bool:
        """Whether a message can be streamed or asked for."""
        return name in self._builders

    def message(self, name: str) -> Outgoing | None:
        """The message as it is now; None if there is nothing to say yet."""
        fields = self._builders[name]()
        return None if fields is None else Outgoing(name, fields)
