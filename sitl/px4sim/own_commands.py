"""The commands that PX4 itself sends to gimbals and cameras, whether there are any or not.

No answer comes, so each is repeated three times. A companion has to pass over them.
"""

from __future__ import annotations

import math
from typing import Final

from sitl.px4sim.autopilot import Autopilot
from sitl.px4sim.state.notice import Outgoing
from sitl.px4sim.state.px4_modes import FlightMode

_GIMBAL_S: Final = 0.25
_REPEAT_S: Final = 0.5
_REPEATS: Final = 3
_CHANGE_SPEED: Final = 178
_GIMBAL_CONTROL: Final = 1000
_GIMBAL_CONFIGURE: Final = 1001
_STOP_VIDEO: Final = 2003
_TAKE_GIMBAL: Final = (1.0, 1.0, -1.0, -1.0, 0.0, 0.0, 0.0)
_RELEASE_GIMBAL: Final = (-3.0, -3.0, -1.0, -1.0, 0.0, 0.0, 0.0)
_LOOK_AHEAD: Final = (*(math.nan,) * 4, 2.0, 0.0, 0.0)
_STOP: Final = (-1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
_CALM: Final = frozenset({FlightMode.AUTO_LAND, FlightMode.AUTO_RTL})

_Params = tuple[float, ...]


class OwnCommands:
    """Notices when a camera or gimbal would have something to do."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._mode: FlightMode | None = None  # flown at the last step
        self._speed_m_s: float | None = None  # the mission's DO_CHANGE_SPEED that was told last
        self._due: list[tuple[float, int, int, _Params]] = []  # when, MAV_CMD, confirmation

    def step(self) -> list[Outgoing]:
        """The COMMAND_LONGs that are due now; to be called after every step."""
        autopilot = self._autopilot
        now_s, mode = autopilot.time_s, autopilot.flying_mode
        if mode is not self._mode:
            if self._mode is FlightMode.AUTO_MISSION:
                self._plan(now_s, _STOP_VIDEO, _STOP, _REPEATS)
            if self._mode is FlightMode.AUTO_MISSION or mode in _CALM:
                self._calm_gimbal(now_s + _GIMBAL_S)
            self._mode = mode
        speed_m_s = autopilot.situation.speed_m_s if mode is FlightMode.AUTO_MISSION else None
        if speed_m_s != self._speed_m_s:
            self._speed_m_s = speed_m_s
            if speed_m_s is not None:
                params = (1.0, speed_m_s, -1.0, 0.0, 0.0, 0.0, math.nan)
                self._plan(now_s, _CHANGE_SPEED, params, _REPEATS)
        due = [entry for entry in self._due if entry[0] <= now_s]
        self._due = [entry for entry in self._due if entry[0] > now_s]
        return [_command(number, attempt, params) for _, number, attempt, params in due]

    def _calm_gimbal(self, at_s: float) -> None:
        self._plan(at_s, _GIMBAL_CONFIGURE, _TAKE_GIMBAL, _REPEATS)
        self._plan(at_s, _GIMBAL_CONTROL, _LOOK_AHEAD, 0)
        self._plan(at_s, _GIMBAL_CONFIGURE, _RELEASE_GIMBAL, 0)

    def _plan(self, at_s: float, number: int, params: _Params, repeats: int) -> None:
        for attempt in range(repeats + 1):
            self._due.append((at_s + attempt * _REPEAT_S, number, attempt, params))


def _command(number: int, attempt: int, params: _Params) -> Outgoing:
    fields: dict[str, float] = {f"param{index + 1}": value for index, value in enumerate(params)}
    fields |= {"target_system": 1, "target_component": 0}
    return Outgoing("COMMAND_LONG", fields | {"command": number, "confirmation": attempt})
