"""A PX4 as its streams of messages, for tests of what is made of them."""

import pytest

from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.px4.mavlink_values import ARMED
from air_router.vehicle.px4.mavsdk_bridge import Received
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry
from air_router.vehicle.vehicle import Telemetry

HOLD, MISSION, LAND, RETURN = 0x03040000, 0x04040000, 0x06040000, 0x05040000
ACTIVE, CRITICAL, TERMINATED = 4, 5, 8
ON_GROUND, IN_AIR, LANDING = 1, 2, 4


RATES_HZ = {
    "GLOBAL_POSITION_INT": 10,
    "HEARTBEAT": 1,
    "CURRENT_MODE": 0.5,
    "SYS_STATUS": 5,
    "GPS_RAW_INT": 2,
    "EXTENDED_SYS_STATE": 1,
    "MISSION_CURRENT": 1,
    "POSITION_TARGET_GLOBAL_INT": 2,
    "SYSTEM_TIME": 1,
}


class Px4:
    """The streams of a PX4, at its rates, of which some may be turned off."""

    def __init__(self, mission, monkeypatch, *, battery=90):
        self.wall_s = 1000.0
        self.boot_s = 50.0
        self.clock = VehicleClock(monotonic=lambda: self.wall_s)
        for room in ("px4_telemetry", "px4_messages"):
            monkeypatch.setattr(f"air_router.vehicle.px4.{room}.loop_s", lambda: self.wall_s)
        monkeypatch.setattr("air_router.vehicle.px4.px4_messages.subscribe", self._subscribe)
        self.events = []
        self.off = set()
        self._handlers = {}
        self.mission = mission
        self.east_m, self.height_m, self.speed_m_s, self.climb_m_s = 0.0, 40.0, 0.0, 0.0
        self.mode, self.intended, self.armed, self.status = MISSION, MISSION, True, ACTIVE
        self.landed, self.item, self.battery, self.fix = IN_AIR, 3, battery, 3
        self.kind, self.autopilot, self.vtol = 2, 12, 0
        self.telemetry = Px4Telemetry(mission.frame, self.clock)
        self.telemetry.listen(self, 1)
        self.telemetry.subscribe(self.events.append)
        for name in RATES_HZ:
            self.sends(name)
        self.run(1.0)

    def _subscribe(self, _direct, name, callback):
        self._handlers[name] = callback

    def sends(self, name, **changes):
        self._handlers[name](Received({**self._fields(name), **changes}, (1, 1), self.wall_s))

    def run(self, seconds, rate=1.0):
        for _ in range(round(seconds * 10)):
            self.wall_s += 0.1 / rate
            self.boot_s += 0.1
            self.east_m += self.speed_m_s * 0.1
            self.height_m += self.climb_m_s * 0.1
            tick = round(self.boot_s * 10)
            for name, hz in RATES_HZ.items():
                if name not in self.off and tick % round(10 / hz) == 0:
                    self.sends(name)

    @property
    def last(self):
        return [event for event in self.events if isinstance(event, Telemetry)][-1]

    def _fields(self, name):
        home = self.mission.home
        lat, lon = self.mission.frame.to_geodetic(home._replace(east_m=home.east_m + self.east_m))
        place = {"lat": round(lat * 1e7), "lon": round(lon * 1e7)}
        boot_ms = round(self.boot_s * 1e3)
        height_mm = round(self.height_m * 1e3)
        fields = {
            "GLOBAL_POSITION_INT": {
                "time_boot_ms": boot_ms,
                **place,
                "alt": 6_700 + height_mm,
                "relative_alt": height_mm,
                "vx": 0,
                "vy": round(self.speed_m_s * 100),
                "hdg": 65535,
                "vz": -round(self.climb_m_s * 100),
            },
            "HEARTBEAT": {
                "type": self.kind,
                "autopilot": self.autopilot,
                "custom_mode": self.mode,
                "base_mode": ARMED if self.armed else 0,
                "system_status": self.status,
            },
            "CURRENT_MODE": {"custom_mode": self.mode, "intended_custom_mode": self.intended},
            "SYS_STATUS": {
                "battery_remaining": self.battery,
                "voltage_battery": 15_000,
                "onboard_control_sensors_health": 0,
            },
            "GPS_RAW_INT": {
                "fix_type": self.fix,
                "satellites_visible": 12,
                "h_acc": 500,
                "time_usec": boot_ms * 1000,
                "alt": 6_700 + height_mm,
            },
            "EXTENDED_SYS_STATE": {"landed_state": self.landed, "vtol_state": self.vtol},
            "MISSION_CURRENT": {"seq": self.item, "total": 9},
            "POSITION_TARGET_GLOBAL_INT": {
                "time_boot_ms": boot_ms,
                "lat_int": place["lat"],
                "lon_int": place["lon"],
                "alt": 6.7 + self.height_m,
            },
            "SYSTEM_TIME": {"time_unix_usec": 0, "time_boot_ms": boot_ms},
        }
        return fields.get(name, {})


@pytest.fixture
def px4(pennovation, monkeypatch):
    return Px4(pennovation, monkeypatch)
