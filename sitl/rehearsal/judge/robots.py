"""Rules of the robots: whom the companion seeks and where, how long it stays, whose goals count.

They work on the messages that robots really exchanged (`SYNCED`), and on the vehicle's true track.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import shapely

from sitl.rehearsal.judge.announcements import StateInterval, state_intervals
from sitl.rehearsal.judge.case import Case, Violation
from sitl.rehearsal.judge.evidence import SceneEventKind
from sitl.rehearsal.judge.mission_reader import Pair
from sitl.rehearsal.judge.space import open_space

_ANY: Final = frozenset({"MAD_ROBOTS", "FORGED"})
"""Positions of a robot contradict each other, time and again."""

_SEEKS: Final = re.compile(r"\bSEARCH (\w+): ")
_MET_S: Final = 1.0
"""So soon after a robot has sent its position, COMM begins."""

_ENDS_S: Final = 1.5
"""So soon after it has all, or its time is over, COMM ends."""

_FARTHEST_M: Final = 10_000.0
"""Nothing is flown to a place that is farther away."""

_MARGIN_M, _FOLLOWS_M, _SLACK_M = 1.5, 8.0, 5.0
"""What ways keep on top of the clearance, how far a robot may drive on before it is followed, and
how far from the nearest possible place the vehicle may hover."""

_DRIVES_M_S, _ROOM_M = 6.0, 10.0
"""No robot drives faster, and no position is farther off by itself."""

_WITHIN_S, _TIMES = 6.0, 5
"""Robots' messages send the vehicle somewhere else no more often in so long."""

_STANDS_M_S: Final = 0.5
_COMM_S: Final = 20.0
"""So long it stays with a robot where the file has no time."""

_GOES_S: Final = 12.0
"""Within that time goals are flown to, or refused."""


class RobotMessage(NamedTuple):
    """A message that a robot handed over.

    Attributes:
        time_s: When.
        peer: Which robot had it.
        maker: Which robot it is of.
        content: Its fields; empty: it cannot be read.
    """

    time_s: float
    peer: str
    maker: str
    content: dict[str, Any]


def _intervals(case: Case) -> list[StateInterval]:
    """Those in a state; none where it is not known what robots handed over."""
    return state_intervals(case) if case.evidence.knows_meetings else []


def _messages(case: Case, topic: str) -> Iterator[RobotMessage]:
    """The messages of robots on a topic, in order of time."""
    for synced in case.evidence.events(SceneEventKind.SYNCED):
        peer, _, _, handed_over = synced.value
        for maker, its_topic, data in handed_over:
            if its_topic == topic:
                yield RobotMessage(synced.time_s, peer, maker, _read(data))


def _read(data: bytes) -> dict[str, Any]:
    def refuse(text: str) -> float:
        raise ValueError(text)

    try:
        content = json.loads(data, parse_constant=refuse)
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}


def _place(case: Case, message: RobotMessage) -> Pair | None:
    """The position in a robot's message, in metres; None: none that can be flown to."""
    degrees = (
        message.content.get("latitude_deg", math.inf),
        message.content.get("longitude_deg", math.inf),
    )
    if not (abs(degrees[0]) <= 90.0 and abs(degrees[1]) <= 180.0):
        return None
    east_m, north_m = map(float, case.mission.frame.metres(*degrees))
    return (east_m, north_m) if math.hypot(east_m, north_m) <= _FARTHEST_M else None


def _sought(case: Case, stay: StateInterval) -> str:
    """The robot that was announced last before the end of a search; empty: none."""
    lines = [m[1] for at_s, text in case.texts if at_s < stay.end_s and (m := _SEEKS.search(text))]
    return lines[-1] if lines else ""


def _was_requested(case: Case, begin_s: float, end_s: float, *verbs: str) -> bool:
    """Whether an operator requested something then (of these, if any are given)."""
    requests = case.evidence.events(SceneEventKind.REQUEST)
    return any(
        begin_s <= h.time_s <= end_s and (not verbs or str(h.value).split()[0] in verbs)
        for h in requests
    )


def contact_begins_it(case: Case) -> Iterator[Violation]:
    """COMM begins when the robot that is sought has just sent its position itself."""
    poses = [message for message in _messages(case, "/pose") if message.peer == message.maker]
    for stay in _intervals(case):
        if stay.state != "COMM":
            continue
        robot = _sought(case, stay)
        met = any(
            message.maker == robot
            and stay.begin_s - _MET_S <= message.time_s <= stay.begin_s + 0.1
            and _place(case, message) is not None
            for message in poses
        )
        if not met:
            text = f"COMM begins, though {robot} has sent no new position"
            yield Violation(stay.begin_s, "contact", text)


def exchange_or_time_ends_it(case: Case) -> Iterator[Violation]:
    """COMM ends when both have all that the other had when it began, or its time is over."""
    synced = [(h.time_s, *h.value[:3]) for h in case.evidence.events(SceneEventKind.SYNCED)]
    for stay in _intervals(case):
        begin_s, end_s = stay.begin_s, stay.end_s
        if stay.state != "COMM" or not case.could_react(begin_s, end_s + _ENDS_S):
            continue
        robot, time_s = _sought(case, stay), case.mission.timers_s.get("communicate_s", _COMM_S)

        def both_s(since_s: float, robot: str = robot) -> float:
            """When both directions of syncs that began since then were over."""
            firsts = (
                next((s[0] for s in synced if s[1:3] == (robot, way) and s[3] > since_s), math.inf)
                for way in ("in", "out")
            )
            return max(firsts)

        if _was_requested(case, begin_s, end_s + 0.1) or stay.after not in {"EXPL", "SEARCH"}:
            continue
        if end_s - begin_s < time_s - _ENDS_S and both_s(begin_s - 0.2) > end_s + 0.1:
            text = f"COMM ends after {end_s - begin_s:.1f} s, before {robot} was exchanged with"
            yield Violation(end_s, "contact", text)
        due_s = min(begin_s + time_s, both_s(begin_s + 0.1)) + _ENDS_S + case.row.notice_s
        if end_s > due_s:
            text = f"COMM with {robot} goes on, though it was to end at {due_s - _ENDS_S:.1f} s"
            yield Violation(due_s, "contact", text)


def it_waits_where_the_robot_is(case: Case) -> Iterator[Violation]:
    """What waited for a robot, or stayed with it, to the end of its time hovers over it."""
    poses = list(_messages(case, "/pose"))
    comm_s = case.mission.timers_s.get("communicate_s", _COMM_S)
    for stay in _intervals(case):
        until_s, index = stay.end_s - 0.2, case.at(stay.end_s - 0.2)
        timed = stay.state == "COMM" and stay.end_s - stay.begin_s > comm_s - 0.5
        timed |= case.has_announced("at the search position", stay.begin_s, until_s)
        requested = _was_requested(case, stay.begin_s, stay.end_s)
        if (
            not timed
            or requested
            or stay.after != "EXPL"
            or not case.could_react(stay.begin_s, until_s)
        ):
            continue
        if case.speed_m_s(case.at(until_s - 1.0), index) > _STANDS_M_S:
            continue  # it follows
        robot, here = _sought(case, stay), case.place(index)
        received = [message for message in poses if message.maker == robot]
        received = [
            message
            for message in received
            if _since_start_s(case, until_s) < message.time_s < until_s
        ]
        if not case.evidence.faults & _ANY:  # else any of the messages may have counted
            received = _drivable(case, received)[-1:]
        places = [place for message in received if (place := _place(case, message)) is not None]
        beside_m = _SLACK_M + float(case.off_m[index])
        if places:
            clear = open_space(case.version_at(until_s).mission.cruised, _MARGIN_M)
            off_m = min(
                math.dist(here, place) - _FOLLOWS_M - clear.distance(shapely.Point(place))
                for place in places
            )
        else:
            off_m = min(math.dist(here, waypoint) for waypoint in case.mission.waypoints)
        if off_m > beside_m:
            where = "its last position" if places else "any waypoint, and it is not known"
            text = f"{stay.state} {robot} {off_m:.0f} m away from {where}"
            yield Violation(until_s, "contact", text)


def _since_start_s(case: Case, time_s: float) -> float:
    """When the companion that runs then was started: it knows of no earlier messages."""
    started = (h.time_s for h in case.evidence.events(SceneEventKind.STARTED))
    return max((at_s for at_s in started if at_s < time_s), default=-math.inf)


def _drivable(case: Case, received: list[RobotMessage]) -> list[RobotMessage]:
    """A robot's positions, in order, without places that it cannot have driven to."""
    kept: list[tuple[RobotMessage, Pair]] = []
    for message in sorted(received, key=lambda message: message.content.get("stamp_s", 0.0)):
        place = _place(case, message)
        if place is None:
            continue
        if kept:
            before, there = kept[-1]
            seconds = message.content.get("stamp_s", 0.0) - before.content.get("stamp_s", 0.0)
            if math.dist(place, there) > _ROOM_M + _DRIVES_M_S * seconds:
                continue
        kept.append((message, place))
    return [message for message, _ in kept]


def robots_do_not_jerk_it_about(case: Case) -> Iterator[Violation]:
    """While it stays with a robot, that one cannot send it here and there many times a second."""
    for stay in _intervals(case):
        if stay.state != "COMM" or _was_requested(case, stay.begin_s, stay.end_s):
            continue
        sent = [m.time_s for m, _ in case.legs if stay.begin_s <= m.time_s <= stay.end_s]
        for first_s, last_s in zip(sent, sent[_TIMES:], strict=False):
            if last_s - first_s <= _WITHIN_S:
                text = f"sent to {_TIMES + 1} places within {last_s - first_s:.1f} s by a robot"
                yield Violation(last_s, "contact", text)
                break


def only_named_robots_send_it(case: Case) -> Iterator[Violation]:
    """Goals of robots that the mission names, for this UAV and in time, are flown to; no others."""
    named = [
        message for message in _messages(case, "/goals") if message.maker in case.mission.goals_from
    ]
    goals = {
        message.content["id"]: message for message in reversed(named) if _is_for_it(case, message)
    }
    stays = _intervals(case)
    begun = 0
    for stay in stays:
        begun += stay.state == "GOTO" and stay.before != "HOLD"
        if stay.state != "GOTO" or _was_requested(case, 0.0, stay.begin_s, "goto"):
            continue
        ours = [message for message in goals.values() if message.time_s <= stay.begin_s]
        if len(ours) < begun:  # each is done once
            yield Violation(
                stay.begin_s, "goals", "GOTO, though no robot that may send it has sent new goals"
            )
        elif stay.after == "EXPL" and case.could_react(stay.begin_s, stay.end_s):
            here = case.place(case.at(stay.end_s))
            lasts = [case.mission.frame.metres(*message.content["points"][-1]) for message in ours]
            off_m = min(math.dist(here, last) for last in lasts)
            if off_m > case.mission.acceptance_m + _SLACK_M:
                text = f"GOTO ends {off_m:.0f} m from the last of the points"
                yield Violation(stay.end_s, "goals", text)
    for message in goals.values():
        due_s = message.time_s + _GOES_S
        states = {case.state(message.time_s), case.state(due_s)}
        done = any(s.state == "GOTO" and message.time_s - 0.1 <= s.begin_s <= due_s for s in stays)
        done |= case.has_announced(
            f"{message.maker}.*(refused|accepted)", message.time_s - 0.1, due_s
        )
        open_to = states <= {"INIT", "SEARCH", "COMM", "EXPL"} and case.could_react(
            message.time_s, due_s
        )
        if open_to and not done:
            yield Violation(due_s, "goals", f"goals of {message.maker} are not flown to")


def _is_for_it(case: Case, message: RobotMessage) -> bool:
    """Whether goals are for this UAV, and not too late."""
    until_s, stamp_s = message.content.get("until_s"), message.content.get("stamp_s", 0.0)
    late = until_s is not None and until_s < stamp_s
    return message.content.get("to") in {None, case.evidence.uav} and not late
