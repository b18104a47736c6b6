"""The messages that the autopilot streams: which ones, how often, and what is in them.

Rates are PX4 1.17's on its SITL links, in simulated hertz, but ATTITUDE (50 instead of 100). Those
are left out that neither a companion nor a ground station flies by: raw sensors, odometry, servos,
SCALED_PRESSURE, VIBRATION, DISTANCE_SENSOR, Remote ID and the like.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from sitl.mavlink import motion_messages as motion
from sitl.mavlink import status_messages as status
from sitl.mavlink.codec import Outgoing
from sitl.mavlink.motion_messages import Fields, boot_ms, boot_us
from sitl.px4sim.autopilot import Autopilot


@dataclass(slots=True)
class Telemetry:
    """All messages that can be streamed or asked for.

    Attributes:
        autopilot: Whose.
        start_unix_s: Unix time of the simulation's start; SYSTEM_TIME goes on from it.
        events_sent: How many EVENTs there were, for their sequence numbers.
    """

    autopilot: Autopilot
    start_unix_s: float
    events_sent: int = 0

    @staticmethod
    def knows(name: str) -> bool:
        """Whether a message can be streamed or asked for."""
        return name in _MESSAGES

    def message(self, name: str) -> Outgoing | None:
        """The message as it is now; None if there is nothing to say yet."""
        fields = _MESSAGES[name].fields(self)
        return None if fields is None else Outgoing(name, fields)

    def system_time(self) -> Fields:
        """Unix time of the simulation."""
        unix_s = self.start_unix_s + self.autopilot.time_s
        return {"time_unix_usec": round(unix_s * 1e6), "time_boot_ms": boot_ms(self.autopilot)}

    def timesync(self) -> Fields:
        """A question for the time of the other side."""
        return {"ts1": boot_us(self.autopilot) * 1000}

    def current_event_sequence(self) -> Fields:
        """The number of the last EVENT."""
        return {"sequence": (self.events_sent - 1) & 0xFFFF, "flags": 0}


@dataclass(frozen=True, slots=True)
class _Message:
    """A message: what is in it, and how often it comes on PX4's links, 0: only when asked for."""

    fields: Callable[[Telemetry], Fields | None]
    onboard_hz: float = 0.0
    ground_hz: float = 0.0
    truth_hz: float = 0.0


def _of(build: Callable[[Autopilot], Fields | None]) -> Callable[[Telemetry], Fields | None]:
    return lambda telemetry: build(telemetry.autopilot)


_MESSAGES: Final[Mapping[str, _Message]] = {
    "HEARTBEAT": _Message(_of(status.heartbeat), 1.0, 1.0, 1.0),
    "SYS_STATUS": _Message(_of(status.sys_status), 5.0, 1.0),
    "SYSTEM_TIME": _Message(Telemetry.system_time, 1.0),
    "GPS_RAW_INT": _Message(_of(motion.gps_raw_int), 8.0, 5.0),
    "ATTITUDE": _Message(_of(motion.attitude), 50.0, 50.0),
    "LOCAL_POSITION_NED": _Message(_of(motion.local_position_ned), 30.0, 50.0),
    "GLOBAL_POSITION_INT": _Message(_of(motion.global_position_int), 50.0, 50.0),
    "VFR_HUD": _Message(_of(motion.vfr_hud), 10.0, 4.0),
    "TIMESYNC": _Message(Telemetry.timesync, 10.0),
    "ALTITUDE": _Message(_of(motion.altitude), 10.0, 1.0),
    "BATTERY_STATUS": _Message(_of(status.battery_status), 0.5, 0.5),
    "ESTIMATOR_STATUS": _Message(_of(status.estimator_status), 1.0, 1.0),
    "HOME_POSITION": _Message(_of(motion.home_position), 0.5, 0.5),
    "EXTENDED_SYS_STATE": _Message(_of(status.extended_sys_state), 5.0, 1.0),
    "CURRENT_EVENT_SEQUENCE": _Message(Telemetry.current_event_sequence, 1.0 / 3.0, 1.0 / 3.0),
    "CURRENT_MODE": _Message(_of(status.current_mode), 0.5, 0.5),
    "POSITION_TARGET_GLOBAL_INT": _Message(_of(motion.position_target_global_int), 10.0, 10.0),
    "WIND_COV": _Message(_of(motion.wind_cov), 10.0, 0.5),
    "HIL_STATE_QUATERNION": _Message(_of(motion.hil_state_quaternion), truth_hz=25.0),
    "FLIGHT_INFORMATION": _Message(_of(status.flight_information)),
    "AUTOPILOT_VERSION": _Message(_of(status.autopilot_version)),
}
ONBOARD_RATES_HZ: Final = {n: m.onboard_hz for n, m in _MESSAGES.items() if m.onboard_hz}
GROUND_RATES_HZ: Final = {n: m.ground_hz for n, m in _MESSAGES.items() if m.ground_hz}
TRUTH_RATES_HZ: Final = {n: m.truth_hz for n, m in _MESSAGES.items() if m.truth_hz}


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

    def due(self, now_s: float) -> list[str]:
        """The messages to be sent now, each once however late."""
        names = [name for name, due_s in self._due_s.items() if due_s <= now_s + 1e-9]
        for name in names:
            following_s = self._due_s[name] + self._intervals_s[name]
            if following_s <= now_s:
                following_s = now_s + self._intervals_s[name]
            self._due_s[name] = following_s
        return names
