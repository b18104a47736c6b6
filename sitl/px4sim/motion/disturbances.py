"""What disturbs the simulated flight: the errors of the autopilot's estimate, and the moving air.

PX4's estimate in its own simulator is 0.1 to 0.2 m off horizontally, and its altitude wanders by
some decimetres; so does, in flight, the altitude of home, which PX4 corrects as it goes.

On a demand of 5 m/s, PX4's own simulator has 3.8 m/s at once, since its controller has to learn the
drag, and creeps up to 5 within 15 seconds; stopping it overshoots by what it learned. So a gust
moves it, and a steady wind only tilts it.
"""

import math
import random
from dataclasses import dataclass
from typing import Final

# Measured on PX4 1.17's own simulator, hovering for two minutes against its truth.
_HORIZONTAL_SIGMA_M: Final = 0.15
_HORIZONTAL_TAU_S: Final = 5.0
_VERTICAL_SIGMA_M: Final = 0.34
_VERTICAL_TAU_S: Final = 10.0
_HOME_SIGMA_M: Final = 0.68
_HOME_TAU_S: Final = 30.0
_COASTING_M_S15: Final = 0.3  # random walk of the velocity's error without positioning
_MOST_SIGMA: Final = 3.0

_DRAG_1_S: Final = 0.58  # of PX4's simulated airframe, by its own speed
_WIND_1_S: Final = 0.2  # of a real small quadrotor: PX4's simulator has no wind
_GUST_TAU_S: Final = 3.0
_TRIM_S: Final = 8.0
_FORGET_S: Final = 4.0
_GUST_SHARE: Final = 0.3
_MOST_TRIM_M_S2: Final = 4.5  # leaning by 25 degrees: what a small quadrotor does at most


class WanderingError:
    """A first-order Gauss-Markov process: zero mean, given spread and correlation time."""

    def __init__(self, sigma: float, tau_s: float) -> None:
        self._sigma = sigma
        self._tau_s = tau_s
        self.value = 0.0  # the error now, in the unit of `sigma`; within three of them

    def step(self, step_s: float, normal: float) -> None:
        """Wander on for `step_s`; `normal` is a draw from the standard normal distribution."""
        keep = math.exp(-step_s / self._tau_s)
        value = self.value * keep + self._sigma * math.sqrt(1.0 - keep * keep) * normal
        most = _MOST_SIGMA * self._sigma  # a rare draw must not look like a fault
        self.value = max(-most, min(most, value))


class EstimateErrors:
    """The errors of position and home altitude; the same seed gives the same errors.

    Attributes:
        north_m: Of the position estimate.
        east_m: Of the position estimate.
        altitude_m: Of the altitude estimate.
        home_altitude_m: Of home's altitude, once in flight.
        resets: How often the estimate has jumped.
    """

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)  # noqa: S311 - noise, not a secret
        self._north = WanderingError(_HORIZONTAL_SIGMA_M, _HORIZONTAL_TAU_S)
        self._east = WanderingError(_HORIZONTAL_SIGMA_M, _HORIZONTAL_TAU_S)
        self._altitude = WanderingError(_VERTICAL_SIGMA_M, _VERTICAL_TAU_S)
        self._home = WanderingError(_HOME_SIGMA_M, _HOME_TAU_S)
        self.north_m = self.east_m = self.altitude_m = self.home_altitude_m = 0.0
        self._sensors = random.Random(f"sensors {seed}")  # noqa: S311 - noise, not a secret
        self._jump = (0.0, 0.0, 0.0)  # north, east, up in m: sum of all jumps
        self._coast = (0.0, 0.0)  # north, east in m: drift since positioning was lost
        self._coast_m_s = (0.0, 0.0)  # of that drift; walks at random
        self.resets = 0

    def jump(self, north_m: float, east_m: float, altitude_m: float = 0.0) -> None:
        """Let the estimate be off by so much more from now on, as after a reset of the EKF."""
        north, east, altitude = self._jump
        self._jump = (north + north_m, east + east_m, altitude + altitude_m)
        self.resets += 1

    def coast(self, step_s: float) -> None:
        """Nothing holds the estimate to the truth: its error grows faster and faster."""
        spread = _COASTING_M_S15 * math.sqrt(step_s)
        north, east = self._coast_m_s
        self._coast_m_s = (
            north + self._sensors.gauss(0.0, spread),
            east + self._sensors.gauss(0.0, spread),
        )
        self._coast = (
            self._coast[0] + self._coast_m_s[0] * step_s,
            self._coast[1] + self._coast_m_s[1] * step_s,
        )

    def recover(self) -> None:
        """Positioning is back: the estimate jumps to where the vehicle is."""
        self._coast = self._coast_m_s = (0.0, 0.0)
        self.resets += 1

    def sensor_noise(self, sigma: float) -> float:
        """A draw for a single measurement; what is measured does not change the flight."""
        return self._sensors.gauss(0.0, sigma)

    def step(self, step_s: float, *, in_air: bool) -> None:
        """Let the errors wander; home's altitude only does in flight."""
        gauss = self._random.gauss
        self._north.step(step_s, gauss(0.0, 1.0))
        self._east.step(step_s, gauss(0.0, 1.0))
        self._altitude.step(step_s, gauss(0.0, 1.0))
        home = gauss(0.0, 1.0)  # drawn always: the same seed means the same noise on every flight
        if in_air:
            self._home.step(step_s, home)
        self.north_m = self._north.value + self._jump[0] + self._coast[0]
        self.east_m = self._east.value + self._jump[1] + self._coast[1]
        self.altitude_m = self._altitude.value + self._jump[2]
        self.home_altitude_m = self._home.value


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

    def blow(self, north_m_s: float, east_m_s: float) -> None:
        """The mean wind is another one from now on, and goes towards there."""
        self._mean = (north_m_s, east_m_s)

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
