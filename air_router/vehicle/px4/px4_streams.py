"""For how long each stream of a PX4 has been missing while others came, and what is no news."""

import math
from collections.abc import Mapping
from typing import Any, Final

from air_router.vehicle.input_limits import IN_AIR_S
from air_router.vehicle.vehicle import Ages

MOST_S: Final = 1.0
"""A pause of all streams counts as no longer: none of them is missing alone then."""

MOVING_CM_S: Final = 100
"""From here on a position, told to a centimetre, differs from the one before."""

LATE_MS: Final = 1000
"""A position from so long before the last one is late; from longer before, of another boot."""

FLYING_M: Final = 5.0
"""What is armed and moves at this altitude above home is not on the ground."""

LIFTED_M: Final = 2.0
"""What climbs so high has lifted off, whatever its landed state says; what falls is not down."""

_ON_GROUND: Final = 1  # MAV_LANDED_STATE
_AGES: Final[Mapping[str, str]] = {
    "GLOBAL_POSITION_INT": "position_s",
    "HEARTBEAT": "armed_s",
    "SYS_STATUS": "battery_s",
    "GPS_RAW_INT": "fix_s",
    "EXTENDED_SYS_STATE": "landed_s",
    "MISSION_CURRENT": "item_s",
    "POSITION_TARGET_GLOBAL_INT": "target_s",
}
_Fields = Mapping[str, Any]


class Streams:
    """Counts the vehicle's time while anything is heard of it.

    Attributes:
        heard_s: How long that was.
        targets_from_s: A target that was told before this time of the vehicle is another mode's.
    """

    def __init__(self) -> None:
        self.heard_s = 0.0
        self.targets_from_s = 0.0
        self._last_s: float | None = None  # when anything came last, monotonic
        self._at_s: dict[str, tuple[float, float]] = {}  # by message: newest, and the one before
        self._position: _Fields | None = None  # the newest, believed or not
        self._believed: _Fields | None = None  # the newest that counts
        self._gps_us = 0  # stamp of the newest fix

    def message(self, arrived_s: float, rate: float, most_s: float = MOST_S) -> None:
        """Anything came, at this time on our clock.

        Args:
            arrived_s: When.
            rate: Of the vehicle's time against ours.
            most_s: The vehicle's time went on by no more since the message before.
        """
        if self._last_s is not None:
            passed_s = max(0.0, arrived_s - self._last_s) * rate
            self.heard_s += min(passed_s, most_s, MOST_S)
        self._last_s = max(arrived_s, self._last_s or arrived_s)

    def news(self, name: str, fields: _Fields, *, armed: bool) -> bool:
        """Whether a message says anything: it is not late, frozen, or against all appearance."""
        match name:
            case "GLOBAL_POSITION_INT":
                news = self._is_position(fields)
            case "GPS_RAW_INT":
                before_us, self._gps_us = self._gps_us, fields.get("time_usec", 0)
                news = self._gps_us == 0 or self._gps_us != before_us
            case "EXTENDED_SYS_STATE":
                news = not (
                    fields["landed_state"] == _ON_GROUND and armed and self.moves_above(FLYING_M)
                )
            case "POSITION_TARGET_GLOBAL_INT":
                news = fields["time_boot_ms"] / 1e3 >= self.targets_from_s
            case _:
                news = True
        if news:
            before_s, _ = self._at_s.get(name, (self.heard_s, 0.0))
            self._at_s[name] = (self.heard_s, before_s)
        return news

    def void_position(self) -> None:
        """The position that came last is none that can be used."""
        name = "GLOBAL_POSITION_INT"
        if name in self._at_s:
            _, before_s = self._at_s[name]
            self._at_s[name] = (before_s, before_s)
            self._position = self._believed

    def ages(self) -> Ages:
        """Now; rounded, because records keep them."""
        ages = {age: self._age_s(name) for name, age in _AGES.items()}
        return Ages(**ages, mode_s=min(self._age_s("HEARTBEAT"), self._mode_age_s()))

    def missing(self, age_s: float) -> list[str]:
        """Streams that came and have not for so long, while others do."""
        return [name for name in _AGES if self._age_s(name) >= age_s]

    def _mode_age_s(self) -> float:
        return self._age_s("CURRENT_MODE") if "CURRENT_MODE" in self._at_s else math.inf

    def _age_s(self, name: str) -> float:
        at_s, _ = self._at_s.get(name, (self.heard_s, 0.0))
        return round(self.heard_s - at_s, 1)

    def _is_position(self, fields: _Fields) -> bool:
        """No late one, nor one that repeats the last although its velocity is not zero."""
        last = self._believed = self._position
        if last is None:
            self._position = fields
            return True
        if -LATE_MS <= fields["time_boot_ms"] - last["time_boot_ms"] <= 0:
            return False
        self._position = fields
        moves = math.hypot(fields["vx"], fields["vy"]) >= MOVING_CM_S
        climbs = abs(fields["vz"]) >= MOVING_CM_S
        return not (
            (moves and (fields["lat"], fields["lon"]) == (last["lat"], last["lon"]))
            or (climbs and fields["alt"] == last["alt"])
        )

    def moves_above(self, height_m: float) -> bool:
        """Whether it moves so high above home, by its last position."""
        last = self._position
        if last is None or last["relative_alt"] < height_m * 1e3:
            return False
        return math.hypot(last["vx"], last["vy"], last["vz"]) >= MOVING_CM_S

    def in_air(self, word: bool, *, armed: bool) -> bool:
        """Whether it is in the air: as it reports, and by its height where that is missing."""
        if self._age_s("EXTENDED_SYS_STATE") <= IN_AIR_S:
            return word
        high = self._position is not None and self._position["relative_alt"] >= FLYING_M * 1e3
        return armed and (word or high)
