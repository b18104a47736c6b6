"""The messages that the autopilot streams: which ones, how often, and what is in them.

Rates are PX4 1.17's on its SITL links, in simulated hertz, but ATTITUDE (50 instead of 100) and
those that are left out because no pilot flies by them: SCALED_PRESSURE, VIBRATION, DISTANCE_SENSOR,
GNSS_INTEGRITY, Remote ID and the like.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from sitl.mavlink.control_messages import ControlMessages
from sitl.mavlink.position_messages import PositionMessages
from sitl.mavlink.status_messages import StatusMessages
from sitl.px4sim.autopilot import Autopilot
from sitl.px4sim.state.notice import Outgoing
from sitl.px4sim.state.px4_modes import Px4Version


class StreamSchedule:
    """Message intervals of one link, in simulated seconds.

    Args:
        rates_hz: The link's default rates by message name.
    """

    def __init__(self, rates_hz: Mapping[str, float]) -> None:
        self._defaults_s = {name: 1.0 / rate for name, rate in rates_hz.items()}  # for interval 0
        self._intervals_s = dict(self._defaults_s)  # what is not sent is missing
        self._due_s = dict.fromkeys(self._intervals_s, 0.0)  # simulated time, of the same

    def set_interval(self, name: str, interval_us: float) -> None:
        """SET_MESSAGE_INTERVAL: microseconds; 0 is the default, below 0 is never."""
        if interval_us > 0:
            self._intervals_s[name] = interval_us / 1e6
        elif interval_us == 0 and name in self._defaults_s:
            self._intervals_s[name] = self._defaults_s[name]
        else:
            self._intervals_s.pop(name, None)
            self._due_s.pop(name, None)
            return
        self._due_s[name] = 0.0

    def interval_us(self, name: str) -> int:
        """The present interval; -1 if it is not sent."""
        interval_s = self._intervals_s.get(name)
        return -1 if interval_s is None else round(min(interval_s * 1e6, 2e9))

    def due(self, now_s: float) -> list[str]:
        """The messages to be sent now, each once however late."""
        names = [name for name, due_s in self._due_s.items() if due_s <= now_s + 1e-9]
        for name in names:
            following_s = self._due_s[name] + self._intervals_s[name]
            if following_s <= now_s:
                following_s = now_s + self._intervals_s[name]
            self._due_s[name] = following_s
        return names


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
        self._builders = (  # by message name
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
