"""The PX4 parameters that a mission depends on: the wanted value of each, and why."""

import math
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Final

from air_router.files import Accepted
from air_router.mission import Mission
from air_router.preflight.card import BAD, GOOD, LOOK, Check
from air_router.routing import BRAKING_M_S2, straight_returns
from air_router.vehicle.px4 import Version, name_of
from geo.frame import Point

HARMLESS_JERK_M_S3: Final = 3.0
"""Below this jerk limit PX4 brakes later than the check of a leg assumes."""

_Wanted = Callable[["Mission", float], bool]


@dataclass(frozen=True, slots=True)
class WantedParameter:
    """The wanted value of a parameter.

    Attributes:
        name: PX4's name.
        wanted: The wanted value, as text.
        why: What happens otherwise.
        good: Checks a value.
        stops: Whether a value prevents the take-off.
        accept: Name by which a mission file accepts any other value; without it any other value
            prevents the take-off. None: only reported.
        scaled: PX4's start script multiplies it by the simulation's speed.
        since: The first version of PX4 with it; None: all.
        before: The first version without it again; None: all since.
        replacement: Its replacement from `before` on, as text.
    """

    name: str
    wanted: str
    why: str
    good: _Wanted
    stops: _Wanted = lambda _mission, _value: False
    accept: Accepted | None = None
    scaled: bool = False
    since: Version | None = None
    before: Version | None = None
    replacement: str = ""

    def is_in(self, version: Version | None) -> bool:
        """Whether this version of PX4 has it; an unknown version may."""
        return version is None or (
            (self.since is None or self.since <= version)
            and (self.before is None or version < self.before)
        )

    def check(self, mission: Mission, value: float) -> Check:
        """The check of a value other than the wanted one."""
        found, advice = f"is {value:g}", f"set it to {self.wanted}: {self.why}"
        stops = self.stops(mission, value)
        if stops or self.accept is None:
            return Check(self.name, BAD if stops else LOOK, found, advice)
        return acceptable(mission, self.accept, self.name, found, advice)


def _is(*values: int) -> _Wanted:
    return lambda _mission, value: round(value) in values


def _at_least(limit: float) -> _Wanted:
    return lambda _mission, value: value >= limit


def _less_than(limit: float) -> _Wanted:
    return lambda _mission, value: value < limit


def _farthest_m(mission: Mission, *, with_fences: bool = False) -> float:
    """Distance of the mission's farthest waypoint from home.

    `with_fences`: also of the fences' corners: the vehicle may seek a robot that far away.
    """
    places = [waypoint.position for waypoint in mission.waypoints]
    if with_fences:
        places += [Point(*corner) for fence in mission.fences for corner in fence.corners]
    return max((math.dist(mission.home, place) for place in places), default=0.0)


WANTED: Final = (
    WantedParameter(
        "GF_ACTION",
        "2 (Hold)",
        "the fence on board is the last barrier: 0 and 1 do nothing, Return and Land fly on, "
        "Terminate falls",
        _is(2),
        _is(0, 1, 4),
        accept="fence_action",
    ),
    WantedParameter(
        "GF_MAX_HOR_DIST",
        "0 (no limit), or more than the farthest waypoint's distance from home",
        "PX4 refuses a plan with a farther item, and stops the vehicle there",
        lambda mission, value: value <= 0.0 or value > _farthest_m(mission, with_fences=True),
        lambda mission, value: 0.0 < value <= _farthest_m(mission) + mission.planner.clearance_m,
    ),
    WantedParameter(
        "GF_MAX_VER_DIST",
        "0 (no limit), or more than the mission's highest altitude",
        "PX4 refuses a plan with a higher item, and stops the vehicle there",
        lambda mission, value: value <= 0.0 or value > mission.cruise.upper_m,
        lambda mission, value: 0.0 < value <= mission.cruise.upper_m,
    ),
    WantedParameter(
        "GF_SOURCE",
        "0 (the estimate)",
        "PX4 checks the fence by raw GPS, not by its own estimate",
        _is(0),
    ),
    WantedParameter(
        "NAV_ACC_RAD",
        "at most 10 m",
        "items without a radius of their own count as reached from afar",
        lambda _mission, value: value <= 10.0,
    ),
    WantedParameter(
        "MPC_ACC_HOR",
        f"at least {BRAKING_M_S2 + 0.5:g} m/s2",
        "the check of legs assumes this deceleration",
        _at_least(BRAKING_M_S2 + 0.5),
        _less_than(BRAKING_M_S2),
    ),
    WantedParameter(
        "MPC_JERK_AUTO",
        f"at least {HARMLESS_JERK_M_S3:g} m/s3",
        "PX4 brakes later than the check of legs assumes",
        _at_least(HARMLESS_JERK_M_S3),
        _less_than(HARMLESS_JERK_M_S3 / 2),
    ),
    WantedParameter(
        "MPC_XY_VEL_MAX",
        "at least the mission's speed",
        "the mission takes longer than planned",
        lambda mission, value: value >= mission.speed_m_s,
    ),
    WantedParameter(
        "COM_RC_OVERRIDE",
        "with bit 0",
        "moving the sticks does not take the vehicle over from the mission",
        lambda _mission, value: bool(round(value) & 1),
        accept="sticks_do_not_override",
        before=(1, 18),
        replacement="MAN_OVERRIDE_SPD instead",
    ),
    WantedParameter(
        "MAN_OVERRIDE_SPD",
        "0 or more (stick travel per second; 1 is PX4's default)",
        "no movement of the sticks takes the vehicle over from the mission",
        _at_least(0.0),
        accept="sticks_do_not_override",
        since=(1, 18),
    ),
    WantedParameter(
        "COM_RC_IN_MODE",
        "any but 4 (no manual control)",
        "the pilot has no sticks to take the vehicle over with",
        lambda _mission, value: round(value) != 4,
        accept="sticks_do_not_override",
    ),
    WantedParameter(
        "NAV_DLL_ACT",
        "0 (nothing) or 1 (Hold)",
        "losing the ground station makes PX4 return straight home, not around zones; "
        "5 and 6 drop the vehicle",
        _is(0, 1),
        _is(5, 6),
    ),
    WantedParameter(
        "NAV_RCL_ACT",
        "1 (Hold) to 3 (Land)",
        "losing the remote control drops the vehicle",
        _is(0, 1, 2, 3),
        _is(5, 6),
        before=(1, 18),
    ),
    WantedParameter(
        "NAV_RCL_ACT",
        "1 (Hold) to 3 (Land), or 7 (Hold without failsafe)",
        "losing the remote control drops the vehicle",
        _is(0, 1, 2, 3, 7),
        _is(5, 6),
        since=(1, 18),
    ),
    WantedParameter(
        "COM_GNSSLOSS_ACT",
        "0 (a warning) or 2 (Land)",
        "losing a receiver makes PX4 return straight home, not around zones; 3 drops the vehicle",
        _is(0, 2),
        _is(3),
        since=(1, 18),
    ),
    WantedParameter(
        "COM_FLTMODE_BOOT",
        "any but 3 (Mission) and 17 (Takeoff)",
        "switched on and armed, the vehicle takes off on its own",
        lambda _mission, value: round(value) not in {3, 17},
        since=(1, 18),
    ),
    WantedParameter(
        "COM_OBC_LOSS_T",
        "at most 10 s",
        "the ground station notices late that this computer has failed",
        lambda _mission, value: value <= 10.0,
        scaled=True,
        before=(1, 18),
        replacement="5 s in any case",
    ),
    WantedParameter(
        "COM_LOW_BAT_ACT",
        "3 (Return, then Land)",
        "PX4 only warns of an empty battery",
        _is(2, 3),
    ),
    WantedParameter(
        "BAT_CRIT_THR",
        "below the mission's battery reserve",
        "PX4 returns in a straight line before the mission comes home along its routes",
        lambda mission, value: value < mission.battery_reserve,
        lambda mission, value: value >= mission.battery_reserve,
    ),
    WantedParameter(
        "COM_DISARM_PRFLT",
        "5 to 60 s",
        "armed by hand it disarms before Mission mode is chosen, or never",
        lambda _mission, value: 5.0 <= value <= 60.0,
    ),
    WantedParameter(
        "RTL_RETURN_ALT",
        "at least the mission's altitude",
        "PX4's own Return flies lower than planned",
        lambda mission, value: value >= mission.altitude_above_home_m,
        accept="rtl_altitude",
    ),
    WantedParameter(
        "RTL_DESCEND_ALT",
        "at most the mission's altitude",
        "PX4's own Return ends higher than planned",
        lambda mission, value: value <= mission.altitude_above_home_m,
        accept="rtl_altitude",
    ),
    WantedParameter(
        "RTL_TYPE",
        "0 or 3 (straight to the nearest of home and the rally points)",
        "PX4 returns another way: past home to a rally point, or along the plan's items",
        _is(0, 3),
        accept="rtl_type",
    ),
)


def names(version: Version | None) -> tuple[str, ...]:
    """The parameters to check in a version of PX4; None: unknown version."""
    return tuple(dict.fromkeys(each.name for each in WANTED if each.is_in(version)))


_LAYER: Final = WantedParameter(
    "RTL_RETURN_ALT",
    "the altitude of this UAV's layer",
    "PX4's own Return climbs into another UAV's layer",
    lambda mission, value: value <= mission.ceiling_m,
    lambda mission, value: value > mission.ceiling_m,
)


def parameters(
    mission: Mission,
    values: Mapping[str, float | None],
    *,
    version: Version | None = None,
    absent: Collection[str] = (),
    rate: float = 1.0,
) -> list[Check]:
    """A check for each parameter with another value than wanted, and one for the others.

    Args:
        mission: The mission.
        values: Values by name; None for a parameter that the vehicle did not report.
        version: PX4's version; None: unknown, then `values` has the parameters that exist.
        absent: Parameters that PX4 reports as absent.
        rate: The vehicle's seconds per second of ours: more than 1 in a fast simulation.
    """
    rows = [each for each in WANTED if each.is_in(version)]
    checks: list[Check] = []
    for each in (*rows, _LAYER) if len(mission.layers) > 1 else rows:
        value = values.get(each.name)
        if value is None or each.good(mission, value / max(rate, 1.0) if each.scaled else value):
            continue
        if version is not None or each.name not in {check.name for check in checks}:
            checks.append(each.check(mission, value))
    looked_at = names(version)
    wrong = {check.name for check in checks}
    none = [name for name in looked_at if name in absent]
    unknown = [name for name in looked_at if values.get(name) is None and name not in absent]
    if none:
        found = f"{_px4(version)} has none: {', '.join(none)}"
        advice = "find their replacements in its release notes, and check those"
        checks.append(Check("parameters", LOOK, found, advice))
    if version is None and len(unknown) == len(looked_at):  # one of which always exists
        advice = (
            "make sure that messages arrive at PX4 (the wire to its RX, the port); if PX4 has a "
            "signing key, give --signing-key FILE"
        )
        return [*checks, Check("parameters", BAD, "PX4 answers no request", advice)]
    if unknown:
        found = f"not reported: {', '.join(unknown)}"
        checks.append(Check("parameters", LOOK, found, "check them yourself"))
    good = len(looked_at) - len(none) - len(unknown) - len(wrong)
    found = f"{good} of {len(looked_at)} are as wanted{_gone(version)}"
    return [*checks, Check("parameters", GOOD, found)]


def _px4(version: Version | None) -> str:
    return "PX4" if version is None else f"PX4 {name_of(version)}"


def _gone(version: Version | None) -> str:
    """Parameters removed in this version, with replacements; empty: none."""
    removed = [
        f"{each.name} ({each.replacement})"
        for each in WANTED
        if version is not None and each.replacement and not each.is_in(version)
    ]
    return f"; {_px4(version)} has no {', no '.join(removed)}" if removed else ""


def straight_return(mission: Mission) -> Check:
    """Whether PX4's own Return, which ignores zones, would fly through one."""
    crossing = Counter(name for way in straight_returns(mission) for name in way.cuts)
    if not crossing:
        return Check("return", GOOD, "PX4's straight return is clear from every waypoint")
    worst = [name for name, _ in crossing.most_common()]
    more = f" and {len(worst) - 3} more" if len(worst) > 3 else ""
    return acceptable(
        mission,
        "rtl_crosses_zones",
        "return",
        f"PX4's own Return flies straight, from some waypoints through "
        f"{', '.join(worst[:3])}{more}",
        "the pilot should choose Hold rather than Return; type 'home' to come home along the graph",
    )


def acceptable(mission: Mission, name: Accepted, line: str, found: str, advice: str) -> Check:
    """A check that prevents the flight unless the mission file accepts it by name."""
    if name in mission.accepts:
        return Check(line, LOOK, f"{found} (accepted by the mission file)", advice)
    where = "the mission file"
    if mission.path.suffix == ".plan":
        where = "a mission file ('air-router convert' makes one of a .plan)"
    return Check(line, BAD, found, f"{advice}; or accept it in {where}: accepts: [{name}]")
