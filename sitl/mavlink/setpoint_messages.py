"""Setpoints and sticks as MAVLink brings them: SET_POSITION_TARGET_* and MANUAL_CONTROL."""

from __future__ import annotations

import math
from typing import Any, Final

from sitl.px4sim.modes.direct_modes import Sticks
from sitl.px4sim.motion.guidance import Direct
from sitl.px4sim.state.notice import Notice, Severity
from sitl.px4sim.state.situation import Situation

_LOCAL: Final = 1  # MAV_FRAME
_BODY: Final = 8
_ABOVE_SEA: Final = frozenset({0, 5})
_ABOVE_HOME: Final = frozenset({3, 6})
_ABOVE_GROUND: Final = frozenset({10, 11})
_EVENTS: Final = {"LOCAL_NED": "", "GLOBAL_INT": "gl_"}  # what names PX4's event
_YAW_IGNORED: Final = 1 << 10  # POSITION_TARGET_TYPEMASK
_YAW_RATE_IGNORED: Final = 1 << 11
_POSITION_IGNORED: Final = (1, 2, 4)
_VELOCITY_IGNORED: Final = (8, 16, 32)
_ACCELERATION_IGNORED: Final = (64, 128, 256)


class RefusedSetpointError(Exception):
    """A setpoint that PX4 does not take.

    Attributes:
        notice: What it says about it.
    """

    def __init__(self, notice: Notice) -> None:
        super().__init__(notice.text)
        self.notice = notice


def local_setpoint(message: Any, situation: Situation) -> Direct:
    """A SET_POSITION_TARGET_LOCAL_NED.

    Raises:
        RefusedSetpointError: an unknown frame, or nothing is set.
    """
    frame, mask = message.coordinate_frame, message.type_mask
    if frame not in (_LOCAL, _BODY):
        raise _unknown_frame("LOCAL_NED", frame)
    velocity = _set(mask, _VELOCITY_IGNORED, (message.vx, message.vy, message.vz))
    position: tuple[float | None, float | None, float | None] = (None, None, None)
    if frame == _LOCAL:
        position = _set(mask, _POSITION_IGNORED, (message.x, message.y, message.z))
    elif None in velocity:
        velocity = (None, None, None)
    if frame == _BODY and velocity[0] is not None and velocity[1] is not None:
        cosine, sine = math.cos(situation.heading_rad), math.sin(situation.heading_rad)
        forward, right = velocity[0], velocity[1]
        velocity = (
            cosine * forward - sine * right,
            sine * forward + cosine * right,
            velocity[2],
        )
    _check_something_is_set("LOCAL_NED", mask, position, velocity)
    north, east, down = position
    altitude_m = None if down is None else situation.ground_altitude_m - down
    return _direct(message, situation, (north, east, altitude_m), velocity)


def global_setpoint(message: Any, situation: Situation) -> Direct:
    """A SET_POSITION_TARGET_GLOBAL_INT.

    Raises:
        RefusedSetpointError: an unknown frame, or nothing is set.
    """
    frame, mask = message.coordinate_frame, message.type_mask
    if frame not in _ABOVE_SEA | _ABOVE_HOME | _ABOVE_GROUND:
        raise _unknown_frame("GLOBAL_INT", frame)
    offset_m = 0.0
    if frame in _ABOVE_HOME:
        offset_m = situation.home_altitude_m
    elif frame in _ABOVE_GROUND:
        offset_m = situation.ground_altitude_m
    place = situation.projection.to_local(message.lat_int * 1e-7, message.lon_int * 1e-7)
    raw = (place[0], place[1], message.alt + offset_m)
    position = _set(mask, _POSITION_IGNORED, raw)
    velocity = _set(mask, _VELOCITY_IGNORED, (message.vx, message.vy, message.vz))
    _check_something_is_set("GLOBAL_INT", mask, position, velocity)
    return _direct(message, situation, position, velocity)


def sticks(message: Any) -> Sticks:
    """A MANUAL_CONTROL; axes out of range are in the middle."""
    throttle = message.z / 500.0 - 1.0 if 0 <= message.z <= 1000 else 0.0
    return Sticks(_stick(message.x), _stick(message.y), throttle, _stick(message.r))


def _direct(
    message: Any,
    situation: Situation,
    position: tuple[float | None, float | None, float | None],
    velocity: tuple[float | None, float | None, float | None],
) -> Direct:
    """North, east and altitude; north, east and down."""
    north, east, altitude_m = position
    place = None
    if north is not None or east is not None:
        place = (
            situation.north_m if north is None else north,
            situation.east_m if east is None else east,
        )
    pace = None
    if velocity[0] is not None or velocity[1] is not None:
        pace = (_number(velocity[0]), _number(velocity[1]))
    mask = message.type_mask
    yaw_rad = None if mask & _YAW_IGNORED or not math.isfinite(message.yaw) else message.yaw
    turn = 0.0 if mask & _YAW_RATE_IGNORED else _number(message.yaw_rate)
    return Direct(
        place,
        altitude_m,
        pace,
        None if velocity[2] is None else -_number(velocity[2]),
        yaw_rad,
        turn,
    )


def _check_something_is_set(
    kind: str, mask: int, position: tuple[float | None, ...], velocity: tuple[float | None, ...]
) -> None:
    pushed = not all(mask & bit for bit in _ACCELERATION_IGNORED)
    if not pushed and all(value is None for value in (*position, *velocity)):
        raise _refusal(kind, "invalid", "invalid")


def _unknown_frame(kind: str, frame: int) -> RefusedSetpointError:
    words = f"coordinate frame {frame} unsupported"
    return _refusal(kind, words, "unsup_coord", bytes((frame & 0xFF,)))


def _refusal(kind: str, words: str, event: str, arguments: bytes = b"") -> RefusedSetpointError:
    text = f"SET_POSITION_TARGET_{kind} {words}"
    event = f"mavlink_rcv_sp_target_{_EVENTS[kind]}{event}"
    notice = Notice(Severity.CRITICAL, text, event, Severity.ERROR, arguments)
    return RefusedSetpointError(notice)


def _set(
    mask: int, bits: tuple[int, int, int], values: tuple[float, float, float]
) -> tuple[float | None, float | None, float | None]:
    first, second, third = (
        None if mask & bit else value for bit, value in zip(bits, values, strict=True)
    )
    return first, second, third


def _number(value: float | None) -> float:
    return value if value is not None and math.isfinite(value) else 0.0


def _stick(value: int) -> float:
    return value / 1000.0 if -1000 <= value <= 1000 else 0.0
