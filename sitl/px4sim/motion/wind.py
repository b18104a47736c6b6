"""The air: its drag, and the wind, which push the vehicle about. Pure.

Measured on PX4's own simulator: told to fly 5 m/s the vehicle has 3.8 m/s at once, since its
controller has to learn the drag, and creeps up to 5 within 15 seconds; stopping it overshoots by
what it learned. So a gust moves it, and a steady wind only tilts it.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import Final

from sitl.px4sim.motion.estimator import WanderingError

_DRAG_1_S: Final = 0.58  # of PX4's simulated airframe, by its own speed
_WIND_1_S: Final = 0.2  # of a real small quadrotor: PX4's simulator has no wind
_GUST_TAU_S: Final = 3.0
_TRIM_S: Final = 8.0
_FORGET_S: Final = 4.0
_GUST_SHARE: Final = 0.3
_MOST_TRIM_M_S2: Final = 4.5  # leaning by 25 degrees: what a small quadrotor does at most


@dataclass(frozen=True, slots=True)
class WindSettings:
    """A wind.

    Attributes:
        speed_m_s: Mean.
        from_deg: Where it comes from, as in a weather report: 270 blows to the east.
        gusts_m_s: Spread (one sigma) of the gusts in each direction; None: 0.3 of the mean.
    """

    speed_m_s: float = 0.0
    from_deg: float = 0.0
    gusts_m_s: float | None = None


class Wind:
    """The moving air, and how much of it the vehicle's controller has not made up for yet.

    Attributes:
        north_m_s: Of the air.
        east_m_s: Of the air.
    """

    def __init__(self, settings: WindSettings, seed: int) -> None:
        self._random = random.Random(f"wind {seed}")  # noqa: S311 - weather, not a secret
        towards_rad = math.radians(settings.from_deg) + math.pi
        self._mean = (  # m/s, north and east, towards which it blows
            settings.speed_m_s * math.cos(towards_rad),
            settings.speed_m_s * math.sin(towards_rad),
        )
        gusts = settings.gusts_m_s
        sigma = settings.speed_m_s * _GUST_SHARE if gusts is None else gusts
        self._gusty = sigma > 0.0  # else no step draws a number
        self._gust_north = WanderingError(sigma, _GUST_TAU_S)
        self._gust_east = WanderingError(sigma, _GUST_TAU_S)
        self._trim = (0.0, 0.0)  # the part of the push that the controller makes up for, m/s2
        self.north_m_s = self.east_m_s = 0.0

    def step(
        self, step_s: float, velocity_m_s: tuple[float, float], *, flying: bool
    ) -> tuple[float, float]:
        """Blow on; the push on the vehicle, north and east in m/s2."""
        if self._gusty:
            gauss = self._random.gauss
            self._gust_north.step(step_s, gauss(0.0, 1.0))
            self._gust_east.step(step_s, gauss(0.0, 1.0))
        self.north_m_s = self._mean[0] + self._gust_north.value
        self.east_m_s = self._mean[1] + self._gust_east.value
        if not flying:
            self._trim = (0.0, 0.0)
            return 0.0, 0.0
        push = (
            _WIND_1_S * self.north_m_s - _DRAG_1_S * velocity_m_s[0],
            _WIND_1_S * self.east_m_s - _DRAG_1_S * velocity_m_s[1],
        )
        learning = math.hypot(*push) > math.hypot(*self._trim)
        share = min(step_s / (_TRIM_S if learning else _FORGET_S), 1.0)
        self._trim = (
            self._trim[0] + (push[0] - self._trim[0]) * share,
            self._trim[1] + (push[1] - self._trim[1]) * share,
        )
        if (size := math.hypot(*self._trim)) > _MOST_TRIM_M_S2:
            within = _MOST_TRIM_M_S2 / size
            self._trim = (self._trim[0] * within, self._trim[1] * within)
        return push[0] - self._trim[0], push[1] - self._trim[1]
