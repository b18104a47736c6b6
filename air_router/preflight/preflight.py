"""The pre-flight card: what was looked at, whether it is good, and what to do where it is not.

Pure: facts in, lines out. `preflight_survey` gathers the facts.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Final, Self

from air_router.compass import wind_words
from air_router.controller.monitor.flight_phase import HOME_TOLERANCE_M
from air_router.errors import RefusedError
from air_router.mission.fence_plan import FENCE_TOO_LONG
from air_router.mission.fleet import STANDING_SHARE
from air_router.mission.mission import Mission
from air_router.routing.router import Router
from air_router.vehicle.vehicle import GpsFix, Inspection, Telemetry, VehicleInfo

OLDEST: Final = (1, 14)
"""Before it PX4 has no events and none of the mission reports that a flight rests on."""

FLOWN: Final = ((1, 17), (1, 18))
"""Versions that this was flown with, or written against."""

FEWEST_SATELLITES: Final = 6
GOOD_SATELLITES: Final = 10
WORST_ACCURACY_M: Final = 3.0
STRONG_M_S: Final = 8.0
"""Gusts of a wind like this have cost a simulated vehicle metres of its clearance."""
CLOCK_S: Final = 2.0
WRONG_CLOCK_S: Final = 600.0
"""Zones apply so much longer than a flight may take, anyway."""
KILOMETRES_M: Final = 10_000.0
GPS_ALTITUDE_M: Final = 10.0
WRONG_ALTITUDE_M: Final = 50.0
"""What no satellite receiver with a fix, and no model of the sea's level, is wrong by."""
LEAST_UNIX_S: Final = 1_704_067_200.0  # 2024: before it was written no clock is right
LEAST_DISK_B: Final = 50_000_000
GOOD_DISK_B: Final = 500_000_000


class CheckVerdict(Enum):
    """How a line of the card stands."""

    GOOD = "ok"
    LOOK = "look"
    BAD = "stop"


@dataclass(frozen=True, slots=True)
class Check:
    """One line: what was looked at, how it stands, what was found, what to do."""

    name: str  # the first column of the card
    verdict: CheckVerdict
    found: str  # in words
    advice: str = ""  # what to do; empty: nothing

    @classmethod
    def good(cls, name: str, found: str) -> Self:
        """Nothing needs to be done."""
        return cls(name, CheckVerdict.GOOD, found)

    @classmethod
    def look(cls, name: str, found: str, advice: str) -> Self:
        """The pilot should look at it."""
        return cls(name, CheckVerdict.LOOK, found, advice)

    @classmethod
    def bad(cls, name: str, found: str, advice: str) -> Self:
        """Nothing takes off like that."""
        return cls(name, CheckVerdict.BAD, found, advice)

    def __str__(self) -> str:
        return f"{self.name}: {self.found}" + (f"; {self.advice}" if self.advice else "")


@dataclass(frozen=True, slots=True)
class Card:
    """All lines of a pre-flight check."""

    checks: tuple[Check, ...]

    @property
    def bad(self) -> tuple[Check, ...]:
        """The lines for which nothing takes off."""
        return tuple(check for check in self.checks if check.verdict is CheckVerdict.BAD)

    @property
    def ready(self) -> bool:
        """Whether no line is bad."""
        return not self.bad

    @property
    def summary(self) -> str:
        """How many lines are good, in words."""
        good = sum(check.verdict is CheckVerdict.GOOD for check in self.checks)
        others = "; none of the others stops the flight" if good < len(self.checks) else ""
        return f"{good} of {len(self.checks)} lines are good{others}"

    def lines(self, *, coloured: bool = False, all_of_them: bool = True) -> list[str]:
        """The card as text, one line each; `all_of_them`: also the good ones."""
        shown = [c for c in self.checks if all_of_them or c.verdict is not CheckVerdict.GOOD]
        width = max((len(check.name) for check in shown), default=0)
        return [_line(check, width, coloured=coloured) for check in shown]

    def as_json(self) -> dict[str, object]:
        """For scripts."""
        checks = [asdict(c) | {"verdict": c.verdict.value} for c in self.checks]
        return {"ready": self.ready, "checks": checks}


class PreflightRefusedError(RefusedError):
    """The pre-flight card has a line for which nothing takes off."""

    def __init__(self, card: Card) -> None:
        self.card = card
        reasons = "\n".join(f"  {check}" for check in card.bad)
        super().__init__(f"not ready to fly:\n{reasons}")


_COLOURS: Final[Mapping[CheckVerdict, str]] = {
    CheckVerdict.GOOD: "\x1b[32m",
    CheckVerdict.LOOK: "\x1b[33m",
    CheckVerdict.BAD: "\x1b[31m",
}
_PLAIN: Final = "\x1b[0m"


def _line(check: Check, width: int, *, coloured: bool) -> str:
    mark = check.verdict.value.ljust(4)
    if coloured:
        mark = f"{_COLOURS[check.verdict]}{mark}{_PLAIN}"
    text = f"{mark}  {check.name.ljust(width)}  {check.found}"
    return text + (f"\n{' ' * (width + 8)}-> {check.advice}" if check.advice else "")


# The lines.


def vehicle(info: VehicleInfo) -> Check:
    """Who answers, and whether its version is one that we know."""
    found = f"{info.autopilot} {info.version}, system {info.system_id}"
    match = re.match(r"(\d+)\.(\d+)", info.version)
    version = (int(match[1]), int(match[2])) if match else None
    if version is None:
        return Check.look("vehicle", found, "its version is not known: 1.17 is flown")
    if version < OLDEST:
        return Check.bad("vehicle", found, "too old: install PX4 1.17 or newer")
    if version not in FLOWN:
        return Check.look("vehicle", found, "not flown with this version: 1.17 is")
    return Check.good("vehicle", found)


def standing(telemetry: Telemetry) -> Check:
    """Whether it is on the ground and disarmed."""
    if telemetry.in_air:
        advice = "land it, then start the mission; --resume goes on with one under way"
        return Check.bad("state", f"the vehicle is flying ({_mode(telemetry)})", advice)
    if telemetry.armed:
        advice = "disarm it, then start the mission"
        return Check.bad("state", "the vehicle is armed", advice)
    return Check.good("state", f"on the ground, disarmed ({_mode(telemetry)})")


def _mode(telemetry: Telemetry) -> str:
    return f"{telemetry.mode.value} mode"


def place(mission: Mission, router: Router, info: VehicleInfo, telemetry: Telemetry) -> Check:
    """Whether it stands at the mission's home, with a clear way up, and the fence holds home."""
    away_m = math.dist(telemetry.position, mission.home)
    if away_m > HOME_TOLERANCE_M:
        return Check.bad(
            "place",
            f"the vehicle stands {_far(away_m)} from the mission's home",
            "bring it there, or put home where it stands",
        )
    nearest_m = mission.planner.home_separation_m * STANDING_SHARE
    if len(mission.layers) > 1 and away_m > nearest_m:
        return Check.bad(
            "place",
            f"the vehicle stands {away_m:.1f} m from the home of '{mission.uav}'",
            f"put it within {nearest_m:g} m: the other UAVs keep out of the corridor above home",
        )
    if not router.check_leg(telemetry.position, mission.home):
        return Check.bad(
            "place",
            "the way up from where the vehicle stands to home is not clear",
            "put it on the mission's home",
        )
    if info.home is None:
        return Check.look("place", "the vehicle has no home position yet", "wait for GPS")
    if not mission.airspace.point_clear(info.home):
        return Check.bad(
            "place",
            "the vehicle's home is outside the fence, in a no-fly zone or too close to one",
            "PX4 ignores a fence that does not contain home: move it, or draw the fence wider",
        )
    return Check.good("place", f"{away_m:.1f} m from the mission's home, inside the fence")


def altitude(mission: Mission, info: VehicleInfo, telemetry: Telemetry) -> list[Check]:
    """Whether home is as high as the vehicle stands, and as zones and layers were reckoned with.

    Without such zones and layers, and with a home where it should be, there is no line.
    """
    if telemetry.home_moved is not None:
        up_m = telemetry.home_moved.up_m
        side = "above" if up_m > 0 else "below"
        return [
            Check.bad(
                "altitude",
                f"the vehicle's home is {abs(up_m):.0f} m {side} where it stands",
                "its plan would be flown so much off: set home to where it stands (DO_SET_HOME)",
            )
        ]
    told_m, found_m = mission.home_altitude_amsl_m, info.home_altitude_amsl_m
    needed = len(mission.layers) > 1 or any(zone.band is not None for zone in mission.zones)
    if told_m is None or found_m is None or not needed:
        return []
    off_m = abs(found_m - told_m)
    found = f"home at {found_m:.0f} m above the sea, {told_m:.0f} m in the mission"
    advice = (
        "zones' limits above the sea, and the layers of several UAVs, are reckoned from it: "
        "correct 'altitude_amsl_m' of home"
    )
    if off_m > WRONG_ALTITUDE_M:
        return [Check.bad("altitude", found, advice)]
    if off_m > max(mission.planner.vertical_margin_m, GPS_ALTITUDE_M):
        return [Check.look("altitude", found, advice)]
    return [Check.good("altitude", found)]


def _far(distance_m: float) -> str:
    return f"{distance_m:.0f} m" if distance_m < KILOMETRES_M else f"{distance_m / 1e3:.0f} km"


def health(inspection: Inspection) -> list[Check]:
    """The autopilot's own checks."""
    if not inspection.healthy:
        problems = inspection.problems or ("it does not say why; see the ground station",)
        return [Check.bad("health", "not ready to arm", "; ".join(problems))]
    if inspection.warnings:
        found = "ready to arm, with warnings"
        return [Check.look("health", found, "; ".join(inspection.warnings))]
    return [Check.good("health", "ready to arm")]


def gps(fix: GpsFix | None) -> Check:
    """The satellite receiver."""
    if fix is None:
        return Check.look("GPS", "no word of a receiver", "is GPS_RAW_INT on this link?")
    satellites = "" if fix.satellites is None else f", {fix.satellites} satellites"
    accuracy = "" if fix.accuracy_m is None else f", good to {fix.accuracy_m:.1f} m"
    if not fix.good:
        return Check.bad("GPS", f"no fix{satellites}", "wait, with a free view of the sky")
    found = f"fix{satellites}{accuracy}"
    if fix.satellites is not None and fix.satellites < FEWEST_SATELLITES:
        return Check.bad("GPS", found, f"wait for {GOOD_SATELLITES} satellites")
    if (fix.satellites or GOOD_SATELLITES) < GOOD_SATELLITES or (
        fix.accuracy_m or 0.0
    ) > WORST_ACCURACY_M:
        return Check.look("GPS", found, "better to wait: routes reckon with 1.5 m")
    return Check.good("GPS", found)


def wind(wind_m_s: tuple[float, float] | None) -> Check:
    """The wind, if the vehicle tells it; on the ground most do not."""
    if wind_m_s is None:
        advice = "go by the forecast; in flight PX4 estimates it where EKF2_DRAG_CTRL is set up"
        return Check.look("wind", "the vehicle does not tell it", advice)
    if math.hypot(*wind_m_s) >= STRONG_M_S:
        advice = "gusts may take it nearer to zones than their clearance: better to wait"
        return Check.look("wind", wind_words(wind_m_s), advice)
    return Check.good("wind", wind_words(wind_m_s))


def clock(inspection: Inspection, unix_s: float, *, hours: bool = False) -> Check:
    """Whether our clock is right: gossip and the `hours` of no-fly zones (if any) go by it."""
    if unix_s < LEAST_UNIX_S:
        return Check.bad("clock", "this computer does not know the date", "set its clock")
    if inspection.unix_s is None:
        return Check.look("clock", "the vehicle does not know the time", "wait for GPS")
    off_s = abs(unix_s - inspection.unix_s)
    if off_s > CLOCK_S:
        found = f"this computer and the vehicle's GPS differ by {off_s:.0f} s"
        wrong = hours and off_s > WRONG_CLOCK_S
        advice = "synchronise it (chrony); simulated time runs"
        if wrong:
            advice = "no-fly zones apply at certain hours: synchronise it (chrony)"
        return Check("clock", CheckVerdict.BAD if wrong else CheckVerdict.LOOK, found, advice)
    return Check.good("clock", f"within {off_s:.1f} s of GPS")


def disk(free_bytes: int | None) -> Check:
    """Room for the log."""
    if free_bytes is None:
        return Check.look("disk", "no log is kept", "leave out --no-record to keep one")
    found = f"{free_bytes / 1e9:.1f} GB free for the log"
    if free_bytes < LEAST_DISK_B:
        return Check.bad("disk", found, "make room, or log elsewhere (--log-dir)")
    if free_bytes < GOOD_DISK_B:
        return Check.look("disk", found, "make room: an hour can take 200 MB")
    return Check.good("disk", found)


def notes(mission: Mission) -> list[Check]:
    """What the mission's files say that is not flown as it is written, or not at all."""
    return [
        Check(
            "mission",
            CheckVerdict.BAD if note.code == FENCE_TOO_LONG else CheckVerdict.LOOK,
            note.message,
            f"see {note.path.name}:{note.line}",
        )
        for note in mission.notes
    ]


def peers(reachable: Mapping[str, bool]) -> Check:
    """Who of the team answers now; out of range they need not."""
    if not reachable:
        return Check.look("team", "no peer to talk to", "give the UAV clients in the team")
    away = [name for name, reached in reachable.items() if not reached]
    if not away:
        found = f"{', '.join(reachable)}: their nodes answer (team files are compared in flight)"
        return Check.good("team", found)
    found = f"{', '.join(away)}: no node answers now"
    return Check.look("team", found, "fine if out of range; else is its node running?")
