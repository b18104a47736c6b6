"""False messages to the companion of a flight: from other systems, components and robots."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from air_router.messages import POSE_TOPIC
from geo.frame import Point
from sitl.rehearsal.fakes import CarriedMessage, pose
from sitl.rehearsal.scenario import Scenario

_RETURN, _LAND, _HOLD = 0x05040000, 0x06040000, 0x03040000  # HEARTBEAT.custom_mode
_EMERGENCY, _ACTIVE = 6, 4  # MAV_STATE
_ARMED, _DISARMED = 209, 81  # MAV_MODE_FLAG
_ELSEWHERE_E7: Final = 4000  # 44 m of latitude
_LOWER_MM: Final = 15_000
_OLD_S: Final = 40.0
_SENSORS: Final = ("present", "enabled", "health")
_BEATS: Final = 3
"""Messages sent in a row: a single one may be taken for noise."""


class ImpersonatedState(NamedTuple):
    """Of the vehicle that is impersonated.

    Attributes:
        latitude_e7: Where it is, in 1e-7 degrees.
        longitude_e7: Where it is, in 1e-7 degrees.
        amsl_mm: How high.
        boot_ms: Its clock.
        mode: HEARTBEAT.custom_mode.
    """

    latitude_e7: int
    longitude_e7: int
    amsl_mm: int
    boot_ms: int
    mode: int


def false_messages(state: ImpersonatedState) -> dict[str, tuple[str, Mapping[str, Any]]]:
    """Messages of a vehicle that is elsewhere, and does something else, by what they claim."""
    there = {"lat": state.latitude_e7 + _ELSEWHERE_E7, "lon": state.longitude_e7 - _ELSEWHERE_E7}
    boot, high = {"time_boot_ms": state.boot_ms}, state.amsl_mm - _LOWER_MM
    moving = {"vx": 0, "vy": 0, "vz": 0, "hdg": 9000}
    sensors = {f"onboard_control_sensors_{end}": 0 for end in _SENSORS}
    plan = {"mission_id": 7, "fence_id": 7, "rally_points_id": 7}
    none = {"fix_type": 0, "satellites_visible": 0, "h_acc": 0, "alt": state.amsl_mm}
    home = {"latitude": there["lat"], "longitude": there["lon"], "altitude": state.amsl_mm}
    target = {"lat_int": there["lat"], "lon_int": there["lon"], "alt": high / 1e3}
    return {
        "return": ("HEARTBEAT", _heartbeat(_RETURN)),
        "land": ("HEARTBEAT", _heartbeat(_LAND)),
        "disarmed": ("HEARTBEAT", _heartbeat(_HOLD, _DISARMED)),
        "emergency": ("HEARTBEAT", _heartbeat(state.mode, status=_EMERGENCY)),
        "mode": ("CURRENT_MODE", {"custom_mode": _RETURN, "intended_custom_mode": _RETURN}),
        "elsewhere": (
            "GLOBAL_POSITION_INT",
            {**boot, **there, **moving, "alt": high, "relative_alt": 25_000},
        ),
        "empty": ("SYS_STATUS", {**sensors, "voltage_battery": 9_000, "battery_remaining": 2}),
        "no fix": ("GPS_RAW_INT", {**none, **there, "time_usec": state.boot_ms * 1000}),
        "landed": ("EXTENDED_SYS_STATE", {"landed_state": 1}),
        "item": ("MISSION_CURRENT", {"seq": 1, "total": 3, "mission_state": 3, **plan}),
        "home": ("HOME_POSITION", home),
        "target": ("POSITION_TARGET_GLOBAL_INT", {**boot, **target}),
    }


def _heartbeat(mode: int, base_mode: int = _ARMED, status: int = _ACTIVE) -> Mapping[str, Any]:
    return {
        "type": 2,
        "autopilot": 12,
        "base_mode": base_mode,
        "custom_mode": mode,
        "system_status": status,
        "mavlink_version": 3,
    }


class Strangers:
    """Sends messages in the vehicle's name, and poses in the names of other robots.

    Args:
        flight: Where.
    """

    def __init__(self, flight: Scenario) -> None:
        self._flight = flight
        self._rng = flight.scene.chance("strangers")

    def do_claim(self, what: tuple[str, tuple[int, int]]) -> None:
        """Another system or component sends as the vehicle's autopilot."""
        claim, sender = what
        autopilot = self._flight.autopilot
        latitude_deg, longitude_deg = self._flight.mission.frame.to_geodetic(self._flight.place)
        amsl_m = autopilot.place.altitude_m + autopilot.airframe.up_m
        state = ImpersonatedState(
            latitude_e7=round(latitude_deg * 1e7),
            longitude_e7=round(longitude_deg * 1e7),
            amsl_mm=round(amsl_m * 1e3),
            boot_ms=round(autopilot.time_s * 1e3),
            mode=autopilot.mode.custom_mode,
        )
        for _ in range(_BEATS):
            self._flight.receive_foreign(sender, *false_messages(state)[claim])

    def do_short_range(self, radio_range_m: float) -> None:
        """Robots are received only from so near: a search lasts as long as it may."""
        self._flight.robots.radio_range_m = radio_range_m

    def do_forge(self, how: str) -> None:
        """Robots hand over poses under the names of others: new, old, ours, of no robot."""
        flight, rng = self._flight, self._rng
        frame, unix_s = flight.mission.frame, flight.robots.unix_s
        old_s = _OLD_S if how == "old" else 0.0
        of_other = {"own": str(flight.mission.uav), "unknown": "phantom"}.get(how)

        def forged(name: str, place: Point) -> Callable[[], CarriedMessage]:
            return lambda: (name, POSE_TOPIC, pose(frame, place, unix_s() - old_s))

        flight.robots.forged = [
            forged(of_other or name, Point(place.east_m + rng.uniform(25.0, 60.0), place.north_m))
            for name, place in flight.robots.places.items()
        ]
