"""What an accepted request, or an announcement, obliges the companion to: seen on the wire.

The judge believes the reply to a request only where it takes an obligation on. Whether it was done
already, or is done later, the judge checks by the vehicle's track.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import shapely

from sitl.rehearsal.judge.acceptance import End
from sitl.rehearsal.judge.case import Case, Violation
from sitl.rehearsal.judge.evidence import LAND, SceneEvent, command_of, is_motion
from sitl.rehearsal.judge.inputs import blind, gaps
from sitl.rehearsal.judge.mission_reader import Pair
from sitl.rehearsal.judge.reactions import (
    Incident,
    Reply,
    comes_home,
    is_far,
    places_of,
    requests_of,
    stands,
)
from sitl.rehearsal.judge.space import STOP_M, open_space, room_m

_BRAKES_S, _STANDS_S = 1.0, 12.0
"""A hold is sent within the one, and checked for so long."""

_LEVELS_S, _LEVEL_M = 4.0, 2.5
"""A climb that is stopped ends within the one, and wanders by the other."""

_SAME_M: Final = 1.0
_SETS_OUT_S: Final = 6.0
_BOARD_S: Final = 65.0
"""What waits for a changed fence may wait for so long."""

_ON_S: Final = 45.0
"""A vehicle that flies on has a new leg, or moves, within that time."""

_STATE_S: Final = 3.0
_LANDS_S: Final = 4.0
_WAITS_S: Final = 100.0
_MOVES_M_S: Final = 0.7
_DETOUR, _TURNS_S, _NEAR_M = 2.5, 20.0, 5.0
_OVER_M: Final = 12.0
_READ_S: Final = 0.5
_IN_M: Final = 3.0
_MOVING: Final = frozenset({"home", "goto", "seek", "explore", "resume", "land", "altitude"})
_ENDS: Final = re.compile("coming home: |hands off")


class Obligation(NamedTuple):
    """A request that was accepted, and until when nothing else came between."""

    request: SceneEvent
    reply: Reply
    until_s: float

    @property
    def at_s(self) -> float:
        """When it was requested."""
        return self.request.time_s

    @property
    def verb(self) -> str:
        """What was."""
        return str(self.request.value).split()[0]


def _obligations(case: Case) -> Iterator[Obligation]:
    """All that was accepted, until the next request that was, or an end of the mission."""
    if not case.evidence.received:
        return
    found = [(r, a) for r, a in requests_of(case) if a is not None and a.what == "accepted"]
    ends_s = [at_s for at_s, text in case.texts if _ENDS.search(text)]
    for number, (request, reply) in enumerate(found):
        later = [r.time_s for r, _ in found[number + 1 :] if str(r.value) != "reload"]
        own = 0.6 if str(request.value).startswith("home") else 0.0
        later += [at_s for at_s in ends_s if at_s > request.time_s + own]
        later += [version.from_s for version in case.versions if version.from_s > request.time_s]
        yield Obligation(request, reply, min(later, default=math.inf))


def _lags_s(case: Case) -> float:
    return case.row.notice_s + case.evidence.reaction_s


def _sent(case: Case, begin_s: float, end_s: float) -> bool:
    """Whether a motion left between."""
    return any(begin_s <= m.time_s <= end_s for m in case.commands if is_motion(m))


def _waits(case: Case, at_s: float) -> float:
    """How much longer it may take because a changed file is on its way on board."""
    new = [v.from_s for v in case.versions[1:] if v.from_s - 1.0 <= at_s <= v.from_s + _BOARD_S]
    return _BOARD_S if new else 0.0


def a_hold_that_is_accepted_is_held(case: Case) -> Iterator[Violation]:
    """Whatever the reply, the vehicle stands soon, until something else is requested."""
    for obligation in _obligations(case):
        if obligation.verb != "hold":
            continue
        from_s = obligation.at_s + _BRAKES_S + _lags_s(case)
        until_s = min(obligation.until_s, obligation.at_s + _STANDS_S) - 0.1
        leaves = any(
            v.from_s - 1.0 <= obligation.at_s <= v.from_s + _STANDS_S for v in case.versions[1:]
        )
        if not leaves:
            yield from stands(
                case, Incident(obligation.at_s, "hold was accepted"), (from_s, until_s), "request"
            )


def a_hold_that_is_accepted_ends_a_climb(case: Case) -> Iterator[Violation]:
    """It stays at the height at which it was stopped, too, until something else is requested."""
    for obligation in _obligations(case):
        from_s = obligation.at_s + _LEVELS_S + _lags_s(case)
        until_s = min(obligation.until_s - 0.1, from_s + _STANDS_S)
        if (
            obligation.verb != "hold"
            or from_s >= until_s
            or not case.could_react(obligation.at_s, until_s)
        ):
            continue
        if case.state(from_s) != "HOLD" or case.state(until_s) != "HOLD":
            continue
        first, last = case.at(from_s), case.at(until_s)
        gained_m = float(case.above_m[last] - case.above_m[first])
        low_m = min(case.mission.altitudes_m) - _IN_M
        if abs(gained_m) > _LEVEL_M + case.row.height_m and case.above_m[first] > low_m:
            does = "climbs" if gained_m > 0.0 else "sinks"
            text = f"it {does} by {abs(gained_m):.1f} m, though a hold was accepted at"
            yield Violation(until_s, "request", f"{text} {obligation.at_s:.1f} s")


def points_that_were_flown_to_are_not_again(case: Case) -> Iterator[Violation]:
    """What flies on to the points that are left goes to none from before the hold.

    That it was at a point shows where it has been sent to the next one.
    """
    obligations = [*_obligations(case)]
    for number, obligation in enumerate(obligations):
        if obligation.verb != "resume" or "remaining points" not in obligation.reply.text:
            continue
        tours = [d for d in obligations[:number] if d.verb == "goto"]
        places = places_of(case, tours[-1].request) if tours else []
        sent = [(message.time_s, target) for message, target in case.legs]
        legs = [
            target for at_s, target in sent if tours and tours[-1].at_s <= at_s < obligation.at_s
        ]
        done = max((n for n, p in enumerate(places) if _is_among(p, legs)), default=0)
        for at_s, target in (leg for leg in sent if obligation.at_s <= leg[0] < obligation.until_s):
            left = _is_among(target, places[done:])
            if _is_among(target, places[:done]) and not left:
                text = "sent to a point where it was before it was held"
                yield Violation(at_s, "request", text)
                break


def _is_among(place: Pair, places: Sequence[Pair]) -> bool:
    """Whether one of these is the same place."""
    return any(math.dist(place, other) <= _SAME_M for other in places)


def a_way_that_is_accepted_is_begun(case: Case) -> Iterator[Violation]:
    """After "goto", "seek", "home" and "explore" a leg leaves, or it is there, or on its way."""
    for obligation in _obligations(case):
        if obligation.verb not in {"goto", "seek", "home", "explore", "resume"}:
            continue
        due_s = obligation.at_s + _SETS_OUT_S + _lags_s(case) + _waits(case, obligation.at_s)
        if case.above_m[case.at(obligation.at_s)] < min(case.mission.altitudes_m) - _IN_M:
            continue  # it climbs first
        due_s += _ON_S if obligation.verb in {"explore", "resume"} else 0.0
        if due_s > obligation.until_s or not case.could_react(obligation.at_s, due_s):
            continue
        if _sent(case, obligation.at_s - 0.1, due_s) or _is_there(case, obligation, due_s):
            continue
        text = f"nothing was sent, though {obligation.verb} was accepted at {obligation.at_s:.1f} s"
        yield Violation(due_s, "request", text)


def _is_there(case: Case, obligation: Obligation, due_s: float) -> bool:
    """Whether the vehicle is where it was to go, or flies there already."""
    index = case.at(obligation.at_s)
    here = case.place(index)
    if obligation.verb == "home":
        return case.from_home_m(index) < case.mission.acceptance_m + _IN_M or _moves(
            case, obligation
        )
    if obligation.verb == "goto":
        return not is_far(case, obligation.request)
    if obligation.verb == "explore":
        return _moves(case, obligation)
    if obligation.verb == "resume":
        return _moves(case, obligation) or case.state(due_s) in {"SEARCH", "COMM", "GOTO"}
    robots = case.state(due_s) in {"SEARCH", "COMM"}  # it hovers where it is sought
    return (
        robots
        and min((math.dist(here, place) for place in case.mission.waypoints), default=0.0)
        < 10 * _OVER_M
    )


def _moves(case: Case, obligation: Obligation) -> bool:
    index = case.at(obligation.at_s)
    return case.speed_m_s(max(index - 10, 0), index) > _MOVES_M_S


def points_that_are_accepted_are_flown_to(case: Case) -> Iterator[Violation]:
    """It comes to the first point of a "goto", or as near as areas let it, in the time it takes."""
    for obligation in _obligations(case):
        places = places_of(case, obligation.request) if obligation.verb == "goto" else []
        if not places:
            continue
        index, place = case.at(obligation.at_s), places[0]
        if case.above_m[index] < min(case.mission.altitudes_m) - _IN_M:
            continue
        mission = case.version_at(obligation.at_s).mission
        way_s = _DETOUR * math.dist(case.place(index), place) / mission.speed_m_s
        due_s = obligation.at_s + way_s + _TURNS_S + _lags_s(case) + _waits(case, obligation.at_s)
        if due_s > obligation.until_s or not case.could_react(obligation.at_s, due_s):
            continue
        clear = open_space(mission.cruised, mission.tracking_margin_m)
        beside_m = clear.distance(shapely.Point(place))
        last = case.at(due_s) + 1
        away_m = min(math.dist(case.place(n), place) for n in range(index, last, 5))
        slack_m = mission.acceptance_m + _NEAR_M + float(case.off_m[index:last].max())
        if away_m > 2 * beside_m + slack_m:
            text = (
                f"no nearer than {away_m:.1f} m to a point that was accepted {due_s:.0f} s before"
            )
            yield Violation(due_s, "request", text)


def a_landing_that_is_accepted_is_begun(case: Case) -> Iterator[Violation]:
    """It is commanded to land within seconds, or lands already."""
    for obligation in _obligations(case):
        due_s = obligation.at_s + _LANDS_S + _lags_s(case)
        if (
            obligation.verb != "land"
            or due_s > obligation.until_s
            or not case.could_react(obligation.at_s, due_s)
        ):
            continue
        commanded = any(
            command_of(m) == LAND and obligation.at_s - 0.1 <= m.time_s <= due_s
            for m in case.commands
        )
        if not (commanded or case.lands[case.at(due_s)]):
            text = f"no landing was commanded, though it was accepted at {obligation.at_s:.1f} s"
            yield Violation(due_s, "request", text)


def what_is_resumed_goes_on(case: Case) -> Iterator[Violation]:
    """A "resume" that is accepted while it holds ends that."""
    for obligation in _obligations(case):
        due_s = obligation.at_s + _STATE_S + _lags_s(case)
        holds = case.state(obligation.at_s - 0.01) == "HOLD"
        if obligation.verb != "resume" or not holds or due_s > obligation.until_s:
            continue
        if case.could_react(obligation.at_s, due_s) and case.state(due_s) == "HOLD":
            text = f"it holds on, though resume was accepted at {obligation.at_s:.1f} s"
            yield Violation(due_s, "request", text)


def points_that_wait_are_answered(case: Case) -> Iterator[Violation]:
    """A request that waits for its time is answered in the end."""
    for request, reply in requests_of(case) if case.evidence.received else ():
        if reply is None or reply.what:
            continue
        due_s = request.time_s + _WAITS_S
        states = {case.state(request.time_s + seconds) for seconds in range(0, 100, 5)}
        open_to = states <= {"INIT", "SEARCH", "COMM", "EXPL"}
        replied = case.has_announced("accepted: |refused: |it expired", request.time_s + 0.1, due_s)
        if open_to and case.could_react(request.time_s, due_s) and not replied:
            yield Violation(due_s, "request", "points that were to wait are forgotten")


def it_comes_home_when_announced(case: Case) -> Iterator[Violation]:
    """After "coming home" it comes home, unless another request is accepted."""
    if not case.evidence.received or End.NOT in case.row.ends:
        return
    requested_s = [d.at_s for d in _obligations(case) if d.verb in _MOVING | {"hold"}]
    lost = blind(gaps(case))
    for at_s, text in case.texts:
        if "coming home: " not in text:
            continue
        if case.row.notice_s and case.lands[case.at(at_s) :].any():
            continue  # over such a link it may take long
        incident = Incident(at_s, "it announced that it comes home")
        found = list(comes_home(case, incident, at_s, lost))
        yield from (v for v in found if not any(at_s + 0.1 < s < v.time_s for s in requested_s))


def it_leaves_a_zone_when_announced(case: Case) -> Iterator[Violation]:
    """It leaves only what a changed file has drawn where it is, or near."""
    for at_s, text in case.texts if case.evidence.received else ():
        if not re.search(r" s  leaving ", text):
            continue
        version = case.version_at(at_s + _READ_S)  # which the scene notes a moment later
        before = [v for v in case.versions if v.until_s <= version.from_s][-1:]
        here = shapely.Point(case.place(case.at(at_s)))
        known = before[0].mission.areas if before else ()
        new = [a for a in version.mission.areas if not any(map(a.same, known))]
        near_m = min((room_m(area, here) for area in new), default=math.inf)
        reach_m = STOP_M + max((area.clearance_m for area in new), default=0.0)
        if near_m > reach_m + float(case.off_m[case.at(at_s)]) + case.row.room_m:
            yield Violation(at_s, "report", f"'{text.strip()}', but nothing new is near")
