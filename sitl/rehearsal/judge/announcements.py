"""Rules of the mission: its states and their times, its robots, its waypoints, the charge it needs.

What the companion announced is held against the mission file, the scene and the true track.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import shapely

from sitl.rehearsal.judge.case import Case, Violation
from sitl.rehearsal.judge.evidence import SceneEventKind, number
from sitl.rehearsal.judge.space import leads_home, open_space

_HOVERS_ALREADY: Final = re.compile("accepted: it hovers over .* already")
_HOLD: Final = 0x03040000
_MOTORS_S, _TAKES_S = 2.0, 13.0
"""Motors that have run for so long run; a pilot has so long to take what hands are off."""

_CHANGE: Final = re.compile(r"\b([A-Z_]+) -> ([A-Z_]+)$")
_ENDS: Final = frozenset({"HOLD", "SEARCH", "EXPL", "GOTO", "HOME", "PASSIVE", "DONE"})
_AFTER: Final = {
    "READY": frozenset({"INIT", "HOME", "PASSIVE", "DONE"}),
    "SEARCH": _ENDS | {"COMM", "IDLE"},
    **dict.fromkeys(("INIT", "COMM", "EXPL", "IDLE", "GOTO"), _ENDS),
    "HOLD": _ENDS - {"HOLD"} | {"LAND"},
    "HOME": _ENDS - {"HOME"} | {"LAND"},
    "LAND": frozenset({"DONE", "PASSIVE"}),
    "PASSIVE": frozenset({"EXPL", "HOME", "DONE"}),
    "DONE": frozenset(),
}
"""docs/state-machine.md, of a UAV that explores."""

_BY_REQUEST: Final = {
    ("", "HOLD"): "it stops and hovers",
    ("", "GOTO"): "it flies",
    ("HOLD", "SEARCH"): "it seeks",
    ("HOLD", "EXPL"): "it resumes|it explores",
    ("HOLD", "LAND"): "it lands where it hovers",
}
"""What begins on request only, from any state or from this one, and the reply to the request."""

_TIMERS: Final = {
    "INIT": "init_s",
    "EXPL": "explore_s",
    "SEARCH": "search_s",
    "COMM": "communicate_s",
    "GOTO": "hold_s",
}
_HOLD_S: Final = 20.0
_REVISIT_S: Final = 30.0
_ARRIVES: Final = {"SEARCH": "at the search position", "GOTO": "at the last point"}
"""Their time begins with this line."""

_BY_TIME: Final = {
    **dict.fromkeys(("INIT", "EXPL"), "SEARCH"),
    **dict.fromkeys(("SEARCH", "GOTO", "COMM"), "EXPL"),
}
_NO_WAY: Final = "no way|left out|no clear way|no robot"
_CALM: Final = frozenset({"NONE", "VANISH", "SENT", "EXPLORED", "IDLE", "LANDED_HERE", "ALTITUDES"})
"""Faults in which nothing keeps the vehicle from its mission."""

_UNCLEAR: Final = "no longer clear when it was due"
"""A leg was decided on, and then kept back: it had been checked for another place, or speed."""

_RECORD_S, _TAKE_OFF_S = 60.0, 8.0
"""What a record, and the autopilot's time of the take-off, may lack of the time in the air."""

_AT_ONCE_S, _LATE_S, _EARLY_S = 0.5, 2.5, 1.0
_BESIDE_M: Final = 1.0
_LANDING_M_S, _LEFT, _SLACK = 0.7, 0.10, 0.04
_DETOUR, _CORNERS_S = 2.0, 40.0


class StateInterval(NamedTuple):
    """A time in one state, the one before, and the one after it; empty: the companion's end."""

    before: str
    state: str
    begin_s: float
    end_s: float
    after: str


def state_intervals(case: Case) -> list[StateInterval]:
    """The states that were announced, in order."""
    found = [(at_s, m[1], m[2]) for at_s, text in case.texts if (m := _CHANGE.search(text))]
    ends = [*found[1:], (float(case.time_s[-1]), "", "")][: len(found)]
    return [
        StateInterval(before, state, at_s, end_s, after if left == state else "")
        for (at_s, before, state), (end_s, left, after) in zip(found, ends, strict=True)
    ]


def _was_accepted(case: Case, at_s: float, pattern: str) -> bool:
    slack_s = _AT_ONCE_S * case.evidence.speed
    return case.has_announced(f"accepted: .*({pattern})", at_s - slack_s, at_s + slack_s)


def states_follow_the_table(case: Case) -> Iterator[Violation]:
    """One state follows another as documented; what begins on request, on an accepted one only."""
    intervals = state_intervals(case)
    for interval, later in pairwise(intervals):
        if later.before not in {interval.state, "READY"}:
            text = f"{later.before} -> {later.state} follows {interval.state}"
            yield Violation(later.begin_s, "state", text)
    for before, state, at_s, _, _ in intervals:
        pattern = _BY_REQUEST.get((before, state)) or _BY_REQUEST.get(("", state))
        if state not in _AFTER.get(before, ()):
            yield Violation(at_s, "state", f"{before} -> {state}")
        elif pattern and not _was_accepted(case, at_s, pattern):
            yield Violation(at_s, "state", f"{before} -> {state} without an accepted request")
        if before == "HOME" and state in {"HOLD", "SEARCH", "EXPL", "GOTO"}:
            texts = [
                text
                for announced_s, text in case.texts
                if announced_s < at_s and "coming home: " in text
            ]
            if not (texts and texts[-1].endswith("'s request")):
                text = f"{before} -> {state}, though no request had it come home"
                yield Violation(at_s, "state", text)


def states_last_as_in_the_file(case: Case) -> Iterator[Violation]:
    """Neither longer nor, if only the time ends them, shorter; held, a state keeps what is left."""
    if not (case.evidence.received and case.evidence.faults <= _CALM):
        return
    held_s: float | None = None  # what the state that was held had left
    for interval in state_intervals(case):
        if interval.state == "HOLD":
            continue
        on = interval.before == "HOLD" and _was_accepted(
            case, interval.begin_s, "it resumes|remaining points"
        )
        limit_s = held_s if on and held_s is not None else _limit_s(case, interval)
        from_s = _from_s(case, interval)
        spent_s = interval.end_s - from_s
        if spent_s > limit_s + _LATE_S:
            text = f"{interval.state} lasted {spent_s:.1f} s, {limit_s:.1f} s are wanted"
            yield Violation(interval.end_s, "state", text)
        timed = _BY_TIME.get(interval.state) == interval.after and not _excused(case, interval)
        if timed and spent_s < limit_s - _EARLY_S:
            text = f"{interval.state} ended {max(spent_s, 0.0):.1f} s after its time began"
            yield Violation(interval.end_s, "state", f"{text}, not {limit_s:.1f} s")
        held_s = max(limit_s - spent_s, 0.0) if math.isfinite(spent_s) else None
        held_s = None if interval.state in {"SEARCH", "COMM"} else held_s  # begun anew


def _limit_s(case: Case, interval: StateInterval) -> float:
    """How long a state lasts, by the request that it serves or the file; infinite: no matter."""
    name = _TIMERS.get(interval.state, "")
    requested = [
        h for h in case.evidence.events(SceneEventKind.REQUEST) if h.time_s <= interval.begin_s
    ]
    sent = [text for h in requested if (text := str(h.value)).startswith("goto")]
    wanted = re.search(r"hold_s=([\d.]+)", sent[-1]) if interval.state == "GOTO" and sent else None
    if wanted:
        return float(wanted[1])
    return case.mission.timers_s.get(name, _HOLD_S if name == "hold_s" else math.inf)


def _from_s(case: Case, interval: StateInterval) -> float:
    """When its time began; infinite: it did not."""
    pattern = _ARRIVES.get(interval.state)
    if pattern is None:
        return interval.begin_s
    arrived_s = (at_s for at_s, text in case.texts if at_s >= interval.begin_s and pattern in text)
    return next((at_s for at_s in arrived_s if at_s <= interval.end_s), math.inf)


def _excused(case: Case, interval: StateInterval) -> bool:
    """Whether a state may end before its time: on request, all explored, synced, or no way."""
    end_s = interval.end_s
    if interval.state in {"INIT", "EXPL"} and explored(case, end_s) == len(case.mission.waypoints):
        return True
    synced = any(
        interval.begin_s + _AT_ONCE_S < at_s <= end_s + _AT_ONCE_S for at_s, _ in _met(case)
    )
    no_way = case.has_announced(_NO_WAY, end_s - _AT_ONCE_S, end_s + _AT_ONCE_S)
    requested = _was_accepted(case, end_s, "it seeks|it explores")
    return requested or no_way or (interval.state == "COMM" and synced)


def explored(case: Case, until_s: float) -> int:
    """How many waypoints it has been at by then in their order, or left out: at most."""
    exploring = np.zeros(len(case.time_s), dtype=bool)
    for interval in state_intervals(case):
        if interval.state in {"INIT", "EXPL"}:
            exploring |= (case.time_s >= interval.begin_s) & (
                case.time_s <= min(interval.end_s, until_s)
            )
    texts = "\n".join(text for at_s, text in case.texts if at_s <= until_s)
    left_out = {n for n in _announced_left_out(texts) if is_kept_out(case, n, until_s)}
    near_m, first = case.mission.acceptance_m + _BESIDE_M + case.off_m, 0
    for number_, waypoint in enumerate(case.mission.waypoints, 1):
        there = np.hypot(*(case.places - waypoint).T) <= near_m
        hits = np.flatnonzero((there & exploring)[first:])
        if not len(hits) and number_ not in left_out:
            return number_ - 1
        first += int(hits[0]) if number_ not in left_out else 0
    return len(case.mission.waypoints)


def _announced_left_out(texts: str) -> set[int]:
    """The waypoints announced as left out: "waypoint 3", "waypoints 3, 4 left out"."""
    lists = re.findall(r"waypoints? ([\d, ]+) left out", texts)
    return {int(number_) for text in lists for number_ in re.findall(r"\d+", text)}


def is_kept_out(case: Case, number_: int, until_s: float) -> bool:
    """Whether a zone or fence keeps it from a waypoint, or from the way there, by then."""
    waypoints = case.mission.waypoints
    if not 1 <= number_ <= len(waypoints):
        return False
    place = waypoints[number_ - 1]
    for version in (v for v in case.versions if v.from_s <= until_s):
        mission = version.mission
        margin_m = mission.tracking_margin_m + _BESIDE_M
        clear = open_space((a for a in mission.cruised if not a.periods), margin_m)
        if not clear.covers(shapely.Point(place)) or not leads_home(mission, place, margin_m):
            return True
    return False


def _met(case: Case) -> list[tuple[float, str]]:
    """When a robot handed its messages over, and which."""
    synced = case.evidence.events(SceneEventKind.SYNCED)
    return [(h.time_s, h.value[0]) for h in synced if h.value[1] == "in"]


def _due(case: Case, robot: str, at_s: float, slack_s: float = 1.0) -> bool:
    """Whether a robot may be sought: all are, until everything is explored; then a while later.

    The while is counted from the last complete exchange in both directions.
    """
    if explored(case, at_s) < len(case.mission.waypoints):
        return True
    ends = {"in": -math.inf, "out": -math.inf}
    for sync in case.evidence.events(SceneEventKind.SYNCED):
        who, direction = sync.value[:2]
        if who == robot and sync.time_s <= at_s:
            ends[direction] = sync.time_s
    revisit_s = case.mission.timers_s.get("revisit_s", _REVISIT_S)
    return at_s - min(ends.values()) >= revisit_s - slack_s


def robots_met_are_left_alone(case: Case) -> Iterator[Violation]:
    """With everything explored no robot is sought again at once, but on request; nor too late."""
    if not (case.evidence.received and case.evidence.faults <= _CALM):
        return
    of = re.compile("SEARCH ([a-z0-9_]+): ")
    for at_s, text in case.texts:
        found = of.search(text)
        if found and not _due(case, found[1], at_s) and not _was_accepted(case, at_s, "it seeks"):
            yield Violation(at_s, "state", f"{found[1]} is sought again, and was met just now")
    for interval in state_intervals(case):
        waits = case.mission.seek if interval.state == "IDLE" else ()
        for robot in (name for name in waits if _due(case, name, interval.end_s, -_LATE_S)):
            yield Violation(interval.end_s, "state", f"it waits, and {robot} is due for a visit")


def robots_are_sought_in_turn(case: Case) -> Iterator[Violation]:
    """Each robot is sought until its contact begins, or its time is over; then the next."""
    met, last = _met(case), ""
    judged = case.evidence.received and case.evidence.faults <= _CALM
    of = re.compile("SEARCH ([a-z0-9_]+): ")
    for interval in state_intervals(case) if judged else ():
        at_s = interval.begin_s
        names = [m[1] for s, text in case.texts if abs(s - at_s) < 0.1 and (m := of.search(text))]
        if interval.state != "SEARCH" or not names:
            continue
        name = names[-1]
        missed = [s for s, who in met if who == name and at_s < s < interval.end_s - _AT_ONCE_S]
        if missed:
            yield Violation(missed[0], "state", f"{name} was received, and is sought on")
        seek = case.mission.seek
        if last in seek and name in seek and not _was_accepted(case, at_s, "it seeks"):
            start = seek.index(last) + 1
            round_ = [*seek[start:], *seek[:start]]
            turn = next((robot for robot in round_ if _due(case, robot, at_s)), name)
            if name != turn and not case.has_announced(_NO_WAY, at_s - _AT_ONCE_S, at_s + 0.1):
                yield Violation(at_s, "state", f"{name} is sought after {last}, not {turn}")
        last = name


def all_waypoints_are_visited(case: Case) -> Iterator[Violation]:
    """Where the time is enough, each is visited in its turn, or announced as left out."""
    count = explored(case, math.inf)
    if case.row.explores and not case.given and count < len(case.mission.waypoints):
        text = f"waypoint {count + 1} was neither visited in its turn nor announced as left out"
        yield Violation(float(case.time_s[-1]), "state", text)


def what_is_resumed_is_known(case: Case) -> Iterator[Violation]:
    """A companion that is started anew takes no waypoint for explored that was not.

    It knows since when it flies, by its record or PX4, unless it announces that this is not known.
    """
    pattern = re.compile(r"in the air for (-?\d+) s, (\d+) of \d+ waypoints explored \((.*)")
    for at_s, text in case.texts:
        found = pattern.search(text)
        if found is None:
            continue
        flown_s, most = at_s - float(case.time_s[int(case.flying.argmax())]), explored(case, at_s)
        early_s = _RECORD_S if found[3].startswith("by its record") else _TAKE_OFF_S
        in_time = flown_s - early_s < float(found[1]) < flown_s + _LATE_S
        if int(found[2]) > most or not (in_time or "is not known" in found[3]):
            wrong = f"{found[0]}, but it flew {flown_s:.0f} s and was at {most} of them"
            yield Violation(at_s, "report", wrong)


def the_charge_covers_the_way_home(case: Case) -> Iterator[Violation]:
    """With `endurance_s` it turns where the way home, landing and 10 % are left, not before."""
    mission = case.mission
    if not math.isfinite(mission.endurance_s):
        return
    messages = case.received("SYS_STATUS")
    charges = [(m.time_s, number(m.fields, "battery_remaining") / 100.0) for m in messages]
    for at_s, charge in charges:
        index = case.at(at_s)
        straight_s = case.from_home_m(index) / mission.speed_m_s + mission.speed_m_s / 2.0
        straight_s += max(mission.altitudes_m) / _LANDING_M_S
        needed, most = (
            way_s / mission.endurance_s + _LEFT
            for way_s in (straight_s, _DETOUR * straight_s + _CORNERS_S)
        )
        out = case.state(at_s) in {"INIT", "SEARCH", "COMM", "EXPL", "IDLE", "GOTO"}
        if out and case.cruises(index) and charge < needed - _SLACK:
            text = f"stays out at {charge:.0%}: home and landing take {needed:.0%} at least"
            yield Violation(at_s, "battery", text)
            break
        turns = case.has_announced("coming home: battery", at_s - 0.6, at_s)
        if turns and charge > max(most, mission.battery_reserve) + _SLACK:
            yield Violation(at_s, "battery", f"comes home at {charge:.0%}, {most:.0%} are enough")
            break
    turned = case.has_announced("coming home: battery", 0.0, math.inf)
    if turned and not case.flying[-1] and charges[-1][1] < _LEFT - _SLACK / 2.0:
        text = f"{charges[-1][1]:.0%} of the battery are left at the end, not {_LEFT:.0%}"
        yield Violation(charges[-1][0], "battery", text)


def the_report_is_what_happened(case: Case) -> Iterator[Violation]:
    """Its states, times, meetings and distances are those of the flight; of one companion's."""
    report, texts = case.evidence.report, "\n".join(text for _, text in case.texts)
    lives = len(list(case.evidence.events(SceneEventKind.STARTED)))
    if not report or not case.evidence.faults <= _CALM or lives > 1:
        return
    armed_s = float(np.ptp(case.time_s[case.armed])) if case.armed.any() else 0.0
    steps_m = np.hypot(*np.diff(case.places[case.flying], axis=0).T)
    flown_m = float(steps_m.sum())
    states = [*dict.fromkeys(interval.state for interval in state_intervals(case))]
    found = {name: len(re.findall(f"COMM {name}: found", texts)) for name in report["robots"]}
    wrong = {
        f"{report['duration_s']} s, not {armed_s:.0f}": abs(report["duration_s"] - armed_s) > 3.0,
        f"{report['distance_m']} m, not {flown_m:.0f}": (
            abs(report["distance_m"] - flown_m) > 20.0 + 0.15 * flown_m
        ),
        f"states {report['states_visited']}": report["states_visited"] != states,
        f"robots, not {found}": any(report["robots"][n]["found"] != found[n] for n in found),
        f"came home because {report['came_home_because']}": (
            "coming home: " in texts and f"coming home: {report['came_home_because']}" not in texts
        ),
    }
    for pattern in (pattern for pattern, is_so in wrong.items() if is_so):
        yield Violation(float(case.time_s[-1]), "report", f"the report has {pattern}")


def an_announced_hover_over_a_robot_is_one(case: Case) -> Iterator[Violation]:
    """A request for the robot that it seeks is answered with "hovers already" in COMM only."""
    for at_s, text in case.texts:
        if _HOVERS_ALREADY.search(text) and case.state(at_s) != "COMM":
            yield Violation(at_s, "request", f"'{text.strip()}' in {case.state(at_s)}")


def no_leg_is_kept_back_in_a_calm_flight(case: Case) -> Iterator[Violation]:
    """Where nothing disturbs it, what was decided on is sent: its leg is as clear as it was."""
    for at_s, text in case.texts if case.evidence.faults <= _CALM else ():
        if _UNCLEAR in text:
            yield Violation(at_s, "report", f"'{text.strip()}', in a flight without a disturbance")


def running_motors_are_not_announced_as_stopped(case: Case) -> Iterator[Violation]:
    """No vehicle that is armed and flies is announced as disarmed in the air."""
    samples = case.evidence.samples
    for at_s, text in case.texts:
        if "disarmed in the air" not in text:
            continue
        about = samples[case.at(at_s - _MOTORS_S) : case.at(at_s) + 1]
        if about and all(sample.armed and not sample.landed for sample in about):
            yield Violation(at_s, "report", f"'{text.strip()}', while its motors run")


def what_no_pilot_takes_is_alarmed_of(case: Case) -> Iterator[Violation]:
    """Released, in Hold, and taken by no pilot: the companion announces that again and again."""
    chosen_s = [
        h.time_s for h in case.evidence.events(SceneEventKind.PILOT, SceneEventKind.REQUEST)
    ]
    for each in case.announced:
        if each.label != "ALARM" or "hands off: " not in each.text or "failsafe" in each.text:
            continue
        begin_s, due_s = each.time_s, each.time_s + _TAKES_S + case.reacts_s
        about = case.evidence.samples[case.at(begin_s + 1.0) : case.at(due_s) + 1]
        hovers = all(s.armed and not s.landed and s.custom_mode == _HOLD for s in about)
        taken = any(begin_s - 1.0 <= at_s <= due_s for at_s in chosen_s)
        if taken or not hovers or not case.could_react(begin_s, due_s, ours=False):
            continue
        if not case.has_announced("not flown by hand", begin_s, due_s):
            yield Violation(due_s, "report", "no pilot takes it, and no alarm requests one")
