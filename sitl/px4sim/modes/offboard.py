"""Offboard mode: setpoints of a companion, as long as they keep coming."""

from __future__ import annotations

import math
from typing import Final

from sitl.px4sim.motion.direct_control import Direct
from sitl.px4sim.motion.guidance import Setpoint, SetpointKind
from sitl.px4sim.state.situation import Situation


class OffboardFlight:
    """Flies the last setpoint that came in."""

    def __init__(self) -> None:
        self._direct = Direct()
        self._heard_s = -math.inf

    def hear(self, direct: Direct, situation: Situation) -> None:
        """A setpoint came in."""
        self._direct, self._heard_s = direct, situation.time_s

    def available(self, situation: Situation) -> bool:
        """Whether setpoints are coming: the last one is not older than COM_OF_LOSS_T."""
        patience_s = situation.parameters.limited("COM_OF_LOSS_T", 0.0, 60.0)
        return situation.time_s - self._heard_s <= patience_s + _SLACK_S

    def activate(self, situation: Situation, last: Setpoint) -> None:
        """See `Flight`."""
        del last
        situation.speed_m_s = None

    def update(self, situation: Situation) -> Setpoint:
        """See `Flight`."""
        if situation.landed and not self._direct.lifts:
            return Setpoint()
        return Setpoint(SetpointKind.DIRECT, direct=self._direct)


_SLACK_S: Final = 0.02
