"""The parameters of a PX4 that a mission rests on: what each should be, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from air_router.navigator import BRAKING_M_S2
from air_router.preflight import Check, Verdict
from air_router.straight_return import straight_returns

if TYPE_CHECKING:
    from air_router.mission import Mission

HARMLESS_JERK_M_S3: Final = 3.0
"""Below this the brakes bite later than the check of a leg reckons with."""

_Wanted = Callable[["Mission", float], bool]


@dataclass(frozen=True, slots=True)
class Wish:
    """What a parameter should be.

    Attributes:
        name: PX4's.
        wanted: In words.
        why: What happens otherwise.
        good: Whether a value is as wanted.
        stops: Whether a value is such that nothing takes off.
    """

    name: str
    wanted: str
    why: str
    good: _Wanted
    stops: _Wanted = lambda _mission, _value: False


def _is(*values: int) -> _Wanted:
    return lambda _mission, value: round(value) in values


def _at_least(limit: float) -> _Wanted:
    return lambda _mission, value: value >= limit


def _less_than(limit: float) -> _Wanted:
    return lambda _mission, value: value < limit


WISHES: Final = (
    Wish(
        "GF_ACTION",
        "2 (Hold)",
        "the fence on board is the second wall: 0 and 1 do nothing, Return and Land fly on, "
        "Terminate falls",
        _is(2),
        _is(0, 1, 4),
    ),
    Wish(
        "GF_SOURCE",
        "0 (the estimate)",
        "the fence is judged by raw GPS, not by the position that is flown",
        _is(0),
    ),
    Wish(
        "NAV_ACC_RAD",
        "at most 10 m",
        "items without a radius of their own count as reached from afar",
        lambda _mission, value: value <= 10.0,
    ),
    Wish(
        "MPC_ACC_HOR",
        f"at least {BRAKING_M_S2 + 0.5:g} m/s2",
        "legs are checked for a vehicle that brakes so well",
        _at_least(BRAKING_M_S2 + 0.5),
        _less_than(BRAKING_M_S2),
    ),
    Wish(
        "MPC_JERK_AUTO",
        f"at least {HARMLESS_JERK_M_S3:g} m/s3",
        "softer brakes bite later than legs are checked for",
        _at_least(HARMLESS_JERK_M_S3),
        _less_than(HARMLESS_JERK_M_S3 / 2),
    ),
    Wish(
        "MPC_XY_VEL_MAX",
        "at least the mission's speed",
        "the mission takes longer than reckoned",
        lambda mission, value: value >= mission.speed_m_s,
    ),
    Wish(
        "COM_RC_OVERRIDE",
        "with bit 0",
        "moving the sticks does not take the vehicle over from the mission",
        lambda _mission, value: bool(round(value) & 1),
    ),
    Wish(
        "NAV_DLL_ACT",
        "0 (nothing) or 1 (Hold)",
        "losing the ground station makes PX4 return straight home, not around zones; "
        "5 and 6 drop the vehicle",
        _is(0, 1),
        _is(5, 6),
    ),
    Wish(
        "NAV_RCL_ACT",
        "1 (Hold) to 3 (Land)",
        "losing the remote control drops the vehicle",
        _is(0, 1, 2, 3),
        _is(5, 6),
    ),
    Wish(
        "COM_OBC_LOSS_T",
        "at most 10 s",
        "the ground station hears late that this computer is gone",
        lambda _mission, value: value <= 10.0,
    ),
    Wish(
        "COM_LOW_BAT_ACT",
        "3 (Return, then Land)",
        "an empty battery is only warned of",
        _is(2, 3),
    ),
    Wish(
        "BAT_CRIT_THR",
        "below the mission's battery reserve",
        "PX4 returns by itself, straight, before the mission comes home along its routes",
        lambda mission, value: value < mission.battery_reserve,
        lambda mission, value: value >= mission.battery_reserve,
    ),
    Wish(
        "COM_DISARM_PRFLT",
        "5 to 60 s",
        "armed by hand it disarms before Mission mode is chosen, or never",
        lambda _mission, value: 5.0 <= value <= 60.0,
    ),
    Wish(
        "RTL_RETURN_ALT",
        "at least the mission's altitude",
        "a return by the autopilot is lower than what was planned",
        lambda mission, value: value >= mission.altitude_above_home_m,
    ),
)
NAMES: Final = tuple(wish.name for wish in WISHES)

_LAYER: Final = Wish(
    "RTL_RETURN_ALT",
    "the altitude of this UAV's layer",
    "a return by the autopilot climbs into the layer of another UAV",
    lambda mission, value: value <= mission.ceiling_m,
    lambda mission, value: value > mission.ceiling_m,
)


def parameters(mission: Mission, values: Mapping[str, float | None]) -> list[Check]:
    """A line for each parameter that is not as wanted, and one for the others."""
    checks = []
    unknown = [name for name in NAMES if values.get(name) is None]
    several = len(mission.layers) > 1
    wishes = (*WISHES, _LAYER) if several else WISHES
    for wish in wishes:
        value = values.get(wish.name)
        if value is None or wish.good(mission, value):
            continue
        verdict = Verdict.BAD if wish.stops(mission, value) else Verdict.LOOK
        advice = f"set it to {wish.wanted}: {wish.why}"
        checks.append(Check(wish.name, verdict, f"is {value:g}", advice))
    if unknown:
        found = f"not told: {', '.join(unknown)}"
        checks.append(Check("parameters", Verdict.LOOK, found, "look at them yourself"))
    wrong = {check.name for check in checks} - {"parameters"}
    good = len(NAMES) - len(unknown) - len(wrong)
    checks.append(Check("parameters", Verdict.GOOD, f"{good} of {len(NAMES)} are as wanted"))
    return checks


def straight_return(mission: Mission) -> Check:
    """Whether PX4's own Return, which knows no zones, would fly through one."""
    crossing = Counter(name for way in straight_returns(mission) for name in way.cuts)
    if not crossing:
        return Check("return", Verdict.GOOD, "PX4's straight return is clear from every waypoint")
    worst = [name for name, _ in crossing.most_common()]
    more = f" and {len(worst) - 3} more" if len(worst) > 3 else ""
    return Check(
        "return",
        Verdict.LOOK,
        f"PX4's own Return flies straight, from some waypoints through "
        f"{', '.join(worst[:3])}{more}",
        "the pilot should choose Hold rather than Return; type 'home' to come home along the graph",
    )
