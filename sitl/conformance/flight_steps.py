"""Steps about where the vehicle is and how it flies."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final

from sitl.conformance.expectations import InMode
from sitl.conformance.steps import Command, Fields, Repeat
from sitl.conformance.talk import DepartureError, Talk

ON_GROUND: Final = 1
IN_AIR: Final = 2
LOCAL_POSITION: Final = 0x0FF8  # type masks: what is ignored
LOCAL_VELOCITY: Final = 0x0DC7
NOTHING: Final = 0x0FFF


@dataclass(frozen=True)
class TakeOff:
    """Arm, NAV_TAKEOFF, and wait until it hovers there in Hold."""

    up_m: float = 15.0

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        Command(400, (1,)).play(talk)
        Command(22, (*(math.nan,) * 6, talk.ground_amsl_m + self.up_m)).play(talk)
        InMode("AUTO_TAKEOFF").play(talk)
        InMode("AUTO_LOITER", 20.0 + self.up_m).play(talk)
        talk.run(3.0)


@dataclass(frozen=True)
class Landed:
    """EXTENDED_SYS_STATE.landed_state becomes 1 (on the ground) within some seconds."""

    within_s: float = 60.0
    state: int = ON_GROUND

    def play(self, talk: Talk) -> None:
        """See `Step`."""

        def come() -> bool:
            state = talk.newest("EXTENDED_SYS_STATE") or {"landed_state": 0}
            return bool(state["landed_state"] == self.state)

        if not talk.run(self.within_s, come):
            raise DepartureError(f"expected landed state {self.state} within {self.within_s:g} s")


@dataclass(frozen=True)
class Disarmed:
    """HEARTBEAT shows that the motors stopped, after a number of seconds within limits."""

    within_s: float
    not_before_s: float = 0.0

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        begun_s = talk.now_s

        def stopped() -> bool:
            beat = talk.newest("HEARTBEAT") or {"base_mode": 128}
            return not beat["base_mode"] & 128

        done = talk.run(self.within_s, stopped)
        took_s = talk.now_s - begun_s
        talk.notes.append(f"disarmed after {took_s:.1f} s" if done else "not disarmed")
        if not done or took_s < self.not_before_s:
            limits = f"{self.not_before_s:g} to {self.within_s:g}"
            raise DepartureError(f"expected disarming after {limits} s, {talk.notes[-1]}")


@dataclass(frozen=True)
class Arrives:
    """The vehicle comes near a place; None leaves an axis out."""

    north_m: float | None
    east_m: float | None = None
    up_m: float | None = None
    near_m: float = 2.0
    within_s: float = 60.0

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        if not talk.run(self.within_s, lambda: self._off_m(talk) <= self.near_m):
            raise DepartureError(f"expected {self} and it is at {_place(talk)}")

    def _off_m(self, talk: Talk) -> float:
        here = talk.position
        pairs = (
            (self.north_m, here.north_m),
            (self.east_m, here.east_m),
            (self.up_m, here.up_m),
        )
        return math.hypot(*(wanted - is_ for wanted, is_ in pairs if wanted is not None))


@dataclass(frozen=True)
class Stays:
    """The vehicle does not leave its place by more than some metres for some seconds."""

    for_s: float
    within_m: float = 2.0

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        start, first = talk.position, len(talk.track)
        talk.run(self.for_s)
        furthest_m = max(
            math.hypot(place.north_m - start.north_m, place.east_m - start.east_m)
            for place in talk.track[first:]
        )
        talk.notes.append(f"left its place by {furthest_m:.1f} m")
        if furthest_m > self.within_m:
            raise DepartureError(
                f"expected to stay within {self.within_m:g} m for {self.for_s:g} s, "
                f"it {talk.notes[-1]}"
            )


@dataclass(frozen=True)
class Furthest:
    """How far north it comes in some seconds, between limits."""

    for_s: float
    least_m: float
    most_m: float

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        first = len(talk.track)
        talk.run(self.for_s)
        furthest_m = max(place.north_m for place in talk.track[first:])
        talk.notes.append(f"came {furthest_m:.1f} m north, is at {_place(talk)}")
        if not self.least_m <= furthest_m <= self.most_m:
            raise DepartureError(
                f"expected it to come {self.least_m:g} to {self.most_m:g} m north, "
                f"it {talk.notes[-1]}"
            )


@dataclass(frozen=True)
class Speed:
    """The mean horizontal speed over some seconds, between limits."""

    for_s: float
    least_m_s: float
    most_m_s: float

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        first = len(talk.track)
        talk.run(self.for_s)
        flown = talk.track[first:]
        pairs = itertools.pairwise(flown)
        way_m = sum(math.hypot(b.north_m - a.north_m, b.east_m - a.east_m) for a, b in pairs)
        speed = way_m / max(flown[-1].at_s - flown[0].at_s, 0.1)
        talk.notes.append(f"{speed:.1f} m/s")
        if not self.least_m_s <= speed <= self.most_m_s:
            raise DepartureError(
                f"expected {self.least_m_s:g} to {self.most_m_s:g} m/s, it flew {speed:.2f}"
            )


@dataclass(frozen=True)
class Climb:
    """The mean vertical speed over some seconds, between limits; sinking is negative."""

    for_s: float
    least_m_s: float
    most_m_s: float

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        start = talk.position
        talk.run(self.for_s)
        end = talk.position
        climb = (end.up_m - start.up_m) / max(end.at_s - start.at_s, 0.1)
        talk.notes.append(f"climbed {climb:.2f} m/s")
        if not self.least_m_s <= climb <= self.most_m_s:
            raise DepartureError(
                f"expected a climb of {self.least_m_s:g} to {self.most_m_s:g} m/s, "
                f"it {talk.notes[-1]}"
            )


@dataclass(frozen=True)
class Setpoints:
    """Stream SET_POSITION_TARGET_LOCAL_NED.

    Attributes:
        north_m: Metres, or m/s with a velocity mask.
        east_m: As north.
        up_m: As north.
        rate_hz: How often.
        mask: What is ignored.
        frame: MAV_FRAME.
    """

    north_m: float
    east_m: float = 0.0
    up_m: float = 15.0
    rate_hz: float = 10.0
    mask: int = LOCAL_POSITION
    frame: int = 1

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        fields: Fields = {
            "time_boot_ms": 0,
            "coordinate_frame": self.frame,
            "type_mask": self.mask,
            "x": self.north_m,
            "y": self.east_m,
            "z": -self.up_m,
            "vx": self.north_m,
            "vy": self.east_m,
            "vz": -self.up_m,
        }
        Repeat("SET_POSITION_TARGET_LOCAL_NED", fields, self.rate_hz).play(talk)


@dataclass(frozen=True)
class GlobalSetpoints:
    """Stream SET_POSITION_TARGET_GLOBAL_INT: metres; `up_m` as the frame takes it."""

    north_m: float
    east_m: float = 0.0
    up_m: float = 15.0
    frame: int = 6
    rate_hz: float = 10.0
    latitude_deg: float | None = None

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        latitude, longitude = talk.degrees(self.north_m, self.east_m)
        above_sea = self.frame in (0, 5)
        fields: Fields = {
            "time_boot_ms": 0,
            "coordinate_frame": self.frame,
            "type_mask": LOCAL_POSITION,
            "lat_int": round((self.latitude_deg or latitude) * 1e7),
            "lon_int": round(longitude * 1e7),
            "alt": self.up_m + (talk.ground_amsl_m if above_sea else 0.0),
        }
        Repeat("SET_POSITION_TARGET_GLOBAL_INT", fields, self.rate_hz).play(talk)


@dataclass(frozen=True)
class Sticks:
    """Stream MANUAL_CONTROL: pitch and roll -1000 to 1000, throttle 0 to 1000, yaw."""

    pitch: int = 0
    roll: int = 0
    throttle: int = 500
    yaw: int = 0
    rate_hz: float = 20.0

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        fields = {"x": self.pitch, "y": self.roll, "z": self.throttle, "r": self.yaw}
        Repeat("MANUAL_CONTROL", fields, self.rate_hz).play(talk)


def _place(talk: Talk) -> str:
    here = talk.position
    return f"({here.north_m:.1f}, {here.east_m:.1f}, {here.up_m:.1f})"
