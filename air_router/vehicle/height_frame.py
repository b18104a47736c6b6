"""The home of the take-off, the reference of a flight's altitudes, although PX4's home may move.

Pure. PX4 flies its plan's altitudes above its current home. Any ground station may move that home
in flight, and the vehicle climbs or descends by as much. The plan was checked relative to the home
of the take-off. It is stored here, and reported altitudes are converted to it.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from air_router.vehicle.limits import HOME_MOVED_ASIDE_M, HOME_MOVED_UP_M
from air_router.words import direction
from geo.frame import Point


class HomeMove(NamedTuple):
    """The offset, in meters, of PX4's home from the home of the take-off."""

    east_m: float
    north_m: float
    up_m: float

    @property
    def changes_heights(self) -> bool:
        """Whether it changes the altitudes of the plan's items."""
        return abs(self.up_m) > HOME_MOVED_UP_M

    def words(self, before_amsl_m: float | None) -> str:
        """The offset as text; `before_amsl_m` is home's altitude before, above mean sea level."""
        words = []
        if self.changes_heights:
            words.append(f"{abs(self.up_m):.0f} m {'up' if self.up_m > 0 else 'down'}")
            if before_amsl_m is not None:
                now_m = before_amsl_m + self.up_m
                words[-1] += f" (from {before_amsl_m:.0f} to {now_m:.0f} m above the sea)"
        aside_m = math.hypot(self.east_m, self.north_m)
        if aside_m >= 1.0:
            words.append(f"{aside_m:.0f} m {direction(self.east_m, self.north_m)}")
        return " and ".join(words)


@dataclass(slots=True)
class HeightFrame:
    """Stores the home of the take-off.

    Attributes:
        home: Its position, meters east/north; None until the vehicle sent it.
        home_amsl_m: Its altitude above mean sea level; None until the vehicle sent it.
        moved: The offset of PX4's home from it; None while both are the same.
    """

    home: Point | None = None
    home_amsl_m: float | None = None
    moved: HomeMove | None = None
    _flew: bool = False  # since it was armed
    _last_report: tuple[float, float, Point | None] | None = (
        None  # the last arguments of `altitude_m`
    )

    def altitude_m(
        self,
        amsl_m: float,
        above_home_m: float,
        home: Point | None,
        *,
        armed: bool,
        in_air: bool,
    ) -> float:
        """The vehicle's altitude above the home of the take-off.

        Until the take-off this is PX4's home. If PX4's home is clearly higher or lower than a
        vehicle on the ground, the ground counts instead.

        Args:
            amsl_m: Its altitude above mean sea level.
            above_home_m: Its altitude above PX4's current home, from the same message.
            home: Position of PX4's home, meters east/north; None: unknown.
            armed: Whether the vehicle is armed.
            in_air: Whether the vehicle is in the air.
        """
        self._flew = (self._flew and armed) or in_air
        now_m = amsl_m - above_home_m
        if self.home_amsl_m is None or not self._flew:
            grounded = not self._flew and abs(above_home_m) > HOME_MOVED_UP_M
            self.home, self.home_amsl_m = home, amsl_m if grounded else now_m
        if self.home is None:
            self.home = home
        self._last_report = (amsl_m, above_home_m, home)
        return self._above_take_off(*self._last_report)

    def took_off_from(self, home_amsl_m: float) -> float | None:
        """Use the home altitude of the take-off that an earlier companion recorded.

        Returns the vehicle's last altitude above it; None: no position was received yet.
        """
        self.home_amsl_m = home_amsl_m
        return None if self._last_report is None else self._above_take_off(*self._last_report)

    def above_m(self, amsl_m: float | None) -> float | None:
        """Convert an altitude above mean sea level to one above that home; None: unknown."""
        if self._last_report is None or amsl_m is None:
            return None
        return amsl_m - self._last_report[0] + self._above_take_off(*self._last_report)

    def _above_take_off(self, amsl_m: float, above_home_m: float, home: Point | None) -> float:
        home_amsl_m = self.home_amsl_m or 0.0
        up_m = amsl_m - above_home_m - home_amsl_m
        east_m, north_m = 0.0, 0.0
        if home is not None and self.home is not None:
            east_m, north_m = home.east_m - self.home.east_m, home.north_m - self.home.north_m
        off_height = abs(up_m) > HOME_MOVED_UP_M
        off_place = math.hypot(east_m, north_m) > HOME_MOVED_ASIDE_M
        self.moved = HomeMove(east_m, north_m, up_m) if off_height or off_place else None
        return amsl_m - home_amsl_m if off_height else above_home_m
