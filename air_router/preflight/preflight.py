"""The checks before a flight: the facts, the verdicts, and what to do.

Pure: takes facts, returns checks of the card; `preflight_survey` gathers the facts. Each check is a
table with condition, verdict, finding and advice; the first true row counts.
"""

import math
from collections.abc import Mapping
from typing import Final

from air_router.controller.states import HOME_TOLERANCE_M
from air_router.mission import FENCE_TOO_LONG, STANDING_SHARE, Mission
from air_router.preflight.card import BAD, GOOD, LOOK, Check, CheckVerdict
from air_router.routing import LANDING_MARGIN, ReturnPlanner, Router
from air_router.vehicle import SET_UP, GpsFix, Inspection, Telemetry, VehicleInfo
from air_router.vehicle.px4 import FACTS, FLOWN, NEWEST, OLDEST, name_of, version_of
from air_router.words import wind_words

FEWEST_SATELLITES: Final = 6
GOOD_SATELLITES: Final = 10
CLOCK_S: Final = 2.0
WRONG_CLOCK_S: Final = 600.0
"""Zones apply longer than the longest flight by this in any case."""
KILOMETRES_M: Final = 10_000.0
GPS_ALTITUDE_M: Final = 10.0
WRONG_ALTITUDE_M: Final = 50.0
"""No satellite receiver with a fix, and no geoid model, is wrong by this much."""
LEAST_UNIX_S: Final = 1_704_067_200.0  # 2024: an earlier clock is wrong
NO_REMOTE_CONTROL: Final = "no remote control signal is received"
"""PX4's warning, in the words of `vehicle.px4`."""
LEAST_DISK_B: Final = 50_000_000
GOOD_DISK_B: Final = 500_000_000
CLIMB_M_S: Final = 1.5
"""Climb speed of PX4's take-off."""
SPARE: Final = 0.2
"""Required charge above the reserve if the vehicle's endurance is unknown."""

_Row = tuple[bool, CheckVerdict, str, str]
"""Condition, verdict, finding, advice."""


def _check(name: str, *rows: _Row) -> Check:
    """The check of the first true row."""
    return next(Check(name, *row[1:]) for row in rows if row[0])


# The checks.


def vehicle(info: VehicleInfo) -> Check:
    """Whether the vehicle is a multicopter with a known version of PX4."""
    version = version_of(info.version)
    airframe = info.airframe
    found = f"{airframe.words}, {info.autopilot} {info.version}, system {info.system_id}"
    if airframe.why_not_flown is not None:
        return Check("vehicle", BAD, f"{found}: {airframe.why_not_flown}", SET_UP)
    flown = f"{name_of(OLDEST)} to {name_of(NEWEST)} were flown"
    if version is None:
        return Check("vehicle", LOOK, found, f"its version is not known: {flown}")
    unverified = "; ".join(fact.fact for fact in FACTS if fact.holds_in(NEWEST))
    return _check(
        "vehicle",
        (version < OLDEST, BAD, found, f"too old: {flown}; install one of them"),
        (
            version > NEWEST,
            LOOK,
            found,
            f"{flown}; try on this version, without zones: {unverified}",
        ),
        (version not in FLOWN, LOOK, found, f"not flown with this version: {flown}"),
        (True, GOOD, found, ""),
    )


def standing(telemetry: Telemetry) -> Check:
    """Whether the vehicle is on the ground and disarmed."""
    mode = f"{telemetry.mode.value} mode"
    land = "land it, then start the mission; --resume goes on with one under way"
    return _check(
        "state",
        (telemetry.in_air, BAD, f"the vehicle is flying ({mode})", land),
        (telemetry.armed, BAD, "the vehicle is armed", "disarm it, then start the mission"),
        (True, GOOD, f"on the ground, disarmed ({mode})", ""),
    )


def place(mission: Mission, router: Router, info: VehicleInfo, telemetry: Telemetry) -> Check:
    """Whether the vehicle is at the mission's home, with a clear climb, inside the fence."""
    away_m = math.dist(telemetry.position, mission.home)
    far = f"{away_m:.0f} m" if away_m < KILOMETRES_M else f"{away_m / 1e3:.0f} km"
    nearest_m = mission.planner.home_separation_m * STANDING_SHARE
    if away_m > HOME_TOLERANCE_M:
        found = f"the vehicle stands {far} from the mission's home"
        return Check("place", BAD, found, "bring it there, or put home where it stands")
    if len(mission.layers) > 1 and away_m > nearest_m:
        found = f"the vehicle stands {away_m:.1f} m from the home of '{mission.uav}'"
        advice = (
            f"put it within {nearest_m:g} m: the other UAVs keep out of the corridor above home"
        )
        return Check("place", BAD, found, advice)
    column = mission.climb_airspace  # with the zones that end below the altitudes of the mission
    clear = router.check_leg(telemetry.position, mission.home)
    if not (clear and column.point_clear(telemetry.position)):
        found = "the way up from where the vehicle stands to home is not clear"
        return Check("place", BAD, found, "put it on the mission's home")
    good = Check("place", GOOD, f"{away_m:.1f} m from the mission's home, inside the fence")
    return _own_home(mission, info) or good


def _own_home(mission: Mission, info: VehicleInfo) -> Check | None:
    """A problem of PX4's own home; None: there is none."""
    if info.home is None:
        return Check("place", LOOK, "the vehicle has no home position yet", "wait for GPS")
    if not mission.airspace.point_clear(info.home):
        found = "the vehicle's home is outside the fence, in a no-fly zone or too close to one"
        advice = "PX4 ignores a fence that does not contain home: move it, or draw the fence wider"
        return Check("place", BAD, found, advice)
    elsewhere_m = math.dist(info.home, mission.home)
    if elsewhere_m > HOME_TOLERANCE_M:
        found = f"the vehicle's home is {elsewhere_m:.0f} m from the mission's"
        advice = "its own Return flies there: set home to its position (DO_SET_HOME)"
        return Check("place", BAD, found, advice)
    return None


def altitude(mission: Mission, info: VehicleInfo, telemetry: Telemetry) -> list[Check]:
    """Whether home's altitude matches the vehicle's, and the mission's for zones and layers.

    Returns no check without such zones and layers, and with a correct home.
    """
    if telemetry.home_moved is not None:
        up_m = telemetry.home_moved.up_m
        side = "above" if up_m > 0 else "below"
        found = f"the vehicle's home is {abs(up_m):.0f} m {side} where it stands"
        advice = "its plan would be off by as much: set home to its position (DO_SET_HOME)"
        return [Check("altitude", BAD, found, advice)]
    given_m, found_m = mission.home_altitude_amsl_m, info.home_altitude_amsl_m
    needed = len(mission.layers) > 1 or any(zone.band is not None for zone in mission.zones)
    if given_m is None or found_m is None or not needed:
        return []
    off_m = abs(found_m - given_m)
    found = f"home at {found_m:.0f} m above the sea, {given_m:.0f} m in the mission"
    advice = (
        "zones' limits above the sea, and the layers of several UAVs, are computed from it: "
        "correct 'altitude_amsl_m' of home"
    )
    slack_m = max(mission.planner.vertical_margin_m, GPS_ALTITUDE_M)
    return [
        _check(
            "altitude",
            (off_m > WRONG_ALTITUDE_M, BAD, found, advice),
            (off_m > slack_m, LOOK, found, advice),
            (True, GOOD, found, ""),
        )
    ]


def health(inspection: Inspection, *, simulated: bool = False) -> Check:
    """PX4's own checks; a simulated vehicle has no remote control."""
    problems = inspection.problems or ("PX4 gives no reason; see the ground station",)
    absent = {NO_REMOTE_CONTROL} if simulated else set()
    warnings = [warning for warning in inspection.warnings if warning not in absent]
    return _check(
        "health",
        (not inspection.healthy, BAD, "not ready to arm", "; ".join(problems)),
        (bool(warnings), LOOK, "ready to arm, with warnings", "; ".join(warnings)),
        (True, GOOD, "ready to arm", ""),
    )


def gps(fix: GpsFix | None, planned_m: float) -> Check:
    """The satellite receiver, compared with the planned accuracy."""
    if fix is None:
        return Check("GPS", LOOK, "no GPS receiver reported", "is GPS_RAW_INT on this link?")
    satellites = 0 if fix.satellites is None else fix.satellites
    seen = (
        f", {satellites} satellites" if fix.satellites is not None else ", satellites not reported"
    )
    found = f"fix{seen}" + ("" if fix.accuracy_m is None else f", good to {fix.accuracy_m:.1f} m")
    poor = satellites < GOOD_SATELLITES
    inaccurate = (fix.accuracy_m or 0.0) > planned_m
    plan = f"routes assume {planned_m:g} m, and the flight holds beyond it"
    few = satellites < FEWEST_SATELLITES and fix.satellites is not None
    return _check(
        "GPS",
        (not fix.good, BAD, f"no fix{seen}", "wait, with a free view of the sky"),
        (few, BAD, found, f"wait for {GOOD_SATELLITES} satellites"),
        (inaccurate, LOOK, found, f"wait, or plan for it (planner.position_accuracy_m): {plan}"),
        (poor, LOOK, found, "better to wait for more"),
        (True, GOOD, found, ""),
    )


def wind(wind_m_s: tuple[float, float] | None, planned_m_s: float) -> Check:
    """The wind, if the vehicle reports it, compared with the planned wind.

    Most vehicles do not report wind on the ground.
    """
    if wind_m_s is None:
        advice = (
            f"go by the forecast, {planned_m_s:g} m/s are planned for; in flight PX4 estimates it "
            "where EKF2_DRAG_CTRL is set up"
        )
        return Check("wind", LOOK, "the vehicle does not report it", advice)
    if math.hypot(*wind_m_s) > planned_m_s:
        advice = (
            f"{planned_m_s:g} m/s are planned for: gusts may take it nearer to zones than their "
            "clearance: wait, or plan for it (planner.wind_m_s)"
        )
        return Check("wind", LOOK, wind_words(wind_m_s), advice)
    return Check("wind", GOOD, wind_words(wind_m_s))


def battery(
    mission: Mission, router: Router, charge: float | None, voltage_v: float | None
) -> Check:
    """The charge (0 to 1), compared with the mission's need including the way home."""
    if charge is None:
        advice = "set up the power module (BAT1_ parameters), and give --duration"
        return Check("battery", LOOK, "its charge is not known: the reserve cannot be kept", advice)
    volts = "" if voltage_v is None else f" ({voltage_v:.1f} V)"
    found = f"{charge:.0%}{volts}, reserve {mission.battery_reserve:.0%}"
    endurance_s = mission.endurance_s
    if endurance_s is None:
        if charge - mission.battery_reserve < SPARE:
            return Check("battery", BAD, found, "charge it, or swap it")
        advice = "set endurance_s in the mission to have this checked"
        return Check("battery", LOOK, found, advice)
    return_planner = ReturnPlanner(router)
    worst = return_planner.worst_waypoint
    out_s = mission.altitude_above_home_m / CLIMB_M_S
    turning = mission.battery_reserve  # the charge at which the vehicle would turn back there
    if worst is not None:
        out_s += return_planner.pace.time_s(worst[1])
        turning = max(turning, return_planner.pace.home_s(worst[1]) / endurance_s + LANDING_MARGIN)
    usable_s = (charge - turning) * endurance_s
    found += f": {max(usable_s, 0.0) / 60:.1f} min before it must come home"
    reach = f"reaching the farthest waypoint takes {out_s / 60:.1f} min: charge it or swap it"
    wanted_s = mission.duration_s or 0.0
    early = f"it will come home before its {wanted_s / 60:.1f} min are over"
    return _check(
        "battery",
        (usable_s < out_s, BAD, found, reach),
        (usable_s < wanted_s, LOOK, found, early),
        (True, GOOD, found, ""),
    )


def clock(inspection: Inspection, unix_s: float, *, hours: bool = False) -> Check:
    """Whether our clock is right: gossip and the `hours` of no-fly zones depend on it."""
    if unix_s < LEAST_UNIX_S:
        return Check("clock", BAD, "this computer does not know the date", "set its clock")
    if inspection.unix_s is None:
        return Check("clock", LOOK, "the vehicle does not know the time", "wait for GPS")
    off_s = abs(unix_s - inspection.unix_s)
    found = f"this computer and the vehicle's GPS differ by {off_s:.0f} s"
    wrong = hours and off_s > WRONG_CLOCK_S
    return _check(
        "clock",
        (wrong, BAD, found, "no-fly zones apply at certain hours: synchronise it (chrony)"),
        (off_s > CLOCK_S, LOOK, found, "synchronise it (chrony); simulated time runs"),
        (True, GOOD, f"within {off_s:.1f} s of GPS", ""),
    )


def disk(free_bytes: int | None) -> Check:
    """Disk space for the record."""
    if free_bytes is None:
        return Check("disk", LOOK, "no log is kept", "leave out --no-record to keep one")
    found = f"{free_bytes / 1e9:.1f} GB free for the log"
    return _check(
        "disk",
        (free_bytes < LEAST_DISK_B, BAD, found, "make room, or log elsewhere (--log-dir)"),
        (free_bytes < GOOD_DISK_B, LOOK, found, "make room: an hour can take 200 MB"),
        (True, GOOD, found, ""),
    )


def notes(mission: Mission) -> list[Check]:
    """Notes on parts of the mission's files that are interpreted differently, or ignored."""
    return [
        Check(
            "mission",
            BAD if note.code == FENCE_TOO_LONG else LOOK,
            note.message,
            f"see {note.path.name}:{note.line}",
        )
        for note in mission.notes
    ]


def peers(reachable: Mapping[str, bool]) -> Check:
    """Which peers answer now; peers out of range need not."""
    away = ", ".join(name for name, reached in reachable.items() if not reached)
    there = f"{', '.join(reachable)}: their nodes answer (team files are compared in flight)"
    missing = "fine if out of range; else is its node running?"
    return _check(
        "team",
        (not reachable, LOOK, "flies alone: no peer to talk to", "with a team: give it clients"),
        (bool(away), LOOK, f"{away}: no node answers now", missing),
        (True, GOOD, there, ""),
    )
