"""Rules on the companion's reactions to incidents and requests, and on its announcements."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import shapely

from sitl.rehearsal.judge.case import Case, Violation
from sitl.rehearsal.judge.evidence import (
    COMPANION,
    EvidenceError,
    SceneEvent,
    SceneEventKind,
    is_motion,
    number,
)
from sitl.rehearsal.judge.mission_reader import Pair
from sitl.rehearsal.judge.space import leads_home, open_space, rooms_of, way_home_m

_BRAKED_S: Final = 4.0
"""Time to stop, in addition to the reaction time."""

_WAY_TURNS_S: Final = 25.0
"""Allowance for turns and stops on the way home."""

_ON_BOARD_S: Final = 30.0
"""Time to upload a changed file; then the way home continues."""

_DETOUR: Final = 2.0
"""Longest flight home, as a multiple of the shortest clear way: it follows waypoints, stops at
each, and possibly none of them is on the shortest way."""

_DETOUR_IN_LAYERS: Final = 3.0
"""The same with climb corridors of other UAVs: these block lines between waypoints, so that a way
along waypoints makes longer detours."""

_MORE_M: Final = 2.0
"""Margin beyond the clearances of a way home; less if there is no such way."""

_ROUNDABOUT: Final = 4.0
"""Longest way home as a multiple of the straight one, if the judge finds no way."""

_SILENT_S: Final = 5.0
"""If the companion receives nothing for longer on the way, it is not expected to come home."""

_SECOND: Final = 25
"""Samples per second of the track, approximately."""

_REPLY: Final = re.compile(
    r"the operator: (accepted|refused): (?!replaced by a newer request|it expired)(.*)$"
    r"|points from the operator (wait) until the vehicle flies on"
)
_REPLY_S: Final = 1.0
_NO_MORE: Final = re.compile("already|as soon as|once the changed|before take-off|on the ground")
"""A reply that matches promises no action now."""

_TURNS_S: Final = 1.0
"""Time limit for sending a hold."""

_CLIMBS_S, _CLIMBS_M_S, _LEVEL_M = 6.0, 0.8, 1.5
"""Start-up time, lowest speed and final error of a requested climb or descent."""

_HOLDS_S: Final = 12.0
"""Time for which a hold is checked; later the mission's duration may end it."""

_SETS_OUT_S: Final = 5.0
"""Time limit for the first motion of a way home; a lost command may have to time out first."""

_LEADS_TO: Final = {
    "hold": "HOLD",
    "goto": "GOTO",
    "seek": "SEARCH",
    "explore": "EXPL",
    "home": "HOME",
    "land": "LAND",
}
"""The state that an accepted request enters at once."""

_BESIDE_M, _STANDS_M_S = 3.0, 1.5
_MARGIN_M: Final = 1.5
"""Margin of ways beyond the clearance."""

_ENDS: Final = re.compile("coming home|hands off|leaving ")
_FLIES: Final = frozenset({"INIT", "SEARCH", "COMM", "EXPL", "IDLE", "GOTO", "HOLD"})

_ANNOUNCED: Final = re.compile(
    r" *[0-9.]+ s  (?!nothing received|.*: (?:accepted|refused): |[A-Z_]+ -> )(.+)"
)
_AGAIN: Final = re.compile(r"^ *[0-9.]+ s  again( [0-9]+ times)?: ")
"""The terminal counts repeated announcements; the ground station receives each of them."""

_SEVERITIES: Final = {"": 6, "WARNING": 4, "ALARM": 2}
"""MAV_SEVERITY by the label of a line: INFO, WARNING, CRITICAL."""

_SENT_S: Final = 1.0
"""Largest time between the line on the terminal and its STATUSTEXT."""

_DEEP_M, _MOVED_M, _STANDS_S, _ALARMED_S = 0.5, 4.0, 25.0, 12.0
"""Depth in a zone, movement and time by which a vehicle counts as hovering in it; and how much
earlier its alarm may have been given."""

_NOT_ON_BOARD: Final = re.compile(" is not on board: ")
_BOARD_S, _LEFT_S = 45.0, 5.0
"""Time limits for uploading a changed fence, and for releasing the vehicle to the pilot."""

_NOT_TAKEN: Final = re.compile("(refused|not (reloaded|changed)): (?!.*as they were)")


class Incident(NamedTuple):
    """Something that requires a reaction of the companion: its time and description."""

    began_s: float
    what: str

    def __str__(self) -> str:
        return f"{self.what} at {self.began_s:.1f} s"


class Reply(NamedTuple):
    """The reply to a request: "accepted" or "refused" (empty: it waits), and its text."""

    what: str
    text: str


def announces(
    case: Case, incident: Incident, pattern: str, due_s: float, before_s: float = 0.1
) -> Iterator[Violation]:
    """The companion announces `pattern` by `due_s`, at most `before_s` before the incident."""
    if not case.has_announced(pattern, incident.began_s - before_s, due_s):
        yield Violation(due_s, "report", f"not announced: {incident}")


def stands(
    case: Case, incident: Incident, span: tuple[float, float], kind: str = "blind"
) -> Iterator[Violation]:
    """Within the span no leg begins, and seconds later the vehicle has slowed to half speed."""
    (from_s, until_s), began_s = span, incident.began_s
    if from_s >= until_s or not case.could_react(began_s, from_s):
        return
    for message, _ in case.legs:
        if from_s <= message.time_s <= until_s and case.could_react(began_s, message.time_s):
            yield Violation(message.time_s, kind, f"a leg, though {incident}")
            break
    for index in range(case.at(from_s + _BRAKED_S), case.at(until_s), _SECOND):
        after = min(index + _SECOND, len(case.time_s) - 1)
        speed_m_s = case.speed_m_s(index, after)
        flies_on = speed_m_s > case.mission.speed_m_s / 2.0
        if flies_on and case.cruises(index) and case.cruises(after):
            text = f"flies on at {speed_m_s:.1f} m/s, though {incident}"
            yield Violation(float(case.time_s[after]), kind, text)
            return


def stops(case: Case, incident: Incident) -> Iterator[Violation]:
    """The vehicle slows down within some seconds, at least for a moment."""
    due_s = incident.began_s + case.reacts_s + _BRAKED_S
    first, last = case.at(incident.began_s), case.at(due_s)
    cruises = all(map(case.cruises, range(first, last + 1)))
    if not cruises or not case.could_react(incident.began_s, due_s):
        return
    parts = range(first, last - _SECOND // 2, _SECOND // 5)
    slowest_m_s = min(case.speed_m_s(index, index + _SECOND // 2) for index in parts)
    if slowest_m_s > case.mission.speed_m_s / 2.0:
        yield Violation(due_s, "held", f"at {slowest_m_s:.1f} m/s all the time, though {incident}")


def comes_home(
    case: Case, incident: Incident, since_s: float, lost: list[tuple[float, float]]
) -> Iterator[Violation]:
    """The vehicle flies home, and begins to land within the time that the way takes.

    Args:
        case: The flight.
        incident: The reason.
        since_s: When the way home begins; infinite: never.
        lost: Periods without position or flight mode, when the vehicle does not fly home.
    """
    if not math.isfinite(since_s) or not case.cruises(case.at(since_s)):
        return
    due_s = _home_by_s(case, since_s)
    changed_s = (version.from_s for version in case.versions[1:])
    waits_s = [at_s + _ON_BOARD_S for at_s in changed_s if since_s < at_s + _ON_BOARD_S]
    while waits_s and waits_s[0] - _ON_BOARD_S < due_s:
        since_s = waits_s.pop(0)  # the vehicle waits for the upload, then takes another way
        if not case.cruises(case.at(since_s)):
            return
        due_s = _home_by_s(case, since_s)
    blind = any(begin_s < due_s and end_s > since_s for begin_s, end_s in lost)
    received_s = [m.time_s for m in case.evidence.received if since_s < m.time_s < due_s]
    silent_s = max((b - a for a, b in pairwise((since_s, *received_s, due_s))), default=0.0)
    silent = bool(case.evidence.received) and silent_s > _SILENT_S
    if blind or silent or not case.could_react(since_s, due_s):
        return
    if not leads_home(case.version_at(due_s).mission, case.place(case.at(due_s))):
        return  # the vehicle hovers, and announces it
    if all(map(case.cruises, range(case.at(since_s), case.at(due_s)))):
        text = f"did not land within {due_s - since_s:.0f} s, though {incident.what}"
        yield Violation(due_s, "home", text)


def _home_by_s(case: Case, since_s: float) -> float:
    """The time limit for the landing of a vehicle that flies home from `since_s` on."""
    mission, place = case.version_at(since_s).mission, case.place(case.at(since_s))
    ways_m = [way_home_m(mission, place, more_m) for more_m in (_MORE_M, 0.0)]
    way_m = next(filter(math.isfinite, ways_m), _ROUNDABOUT * math.hypot(*place))
    detour = _DETOUR_IN_LAYERS if mission.others else _DETOUR
    way_s = detour * way_m / case.mission.speed_m_s
    return since_s + way_s + _WAY_TURNS_S + case.row.notice_s


def accepted_requests_are_done(case: Case) -> Iterator[Violation]:
    """An accepted "hold", "home", "goto" or "altitude" is executed, up to the next request."""
    requests = list(requests_of(case))
    ends_s = [*(request.time_s for request, _ in requests), float(case.time_s[-1])]
    for (request, reply), until_s in zip(requests, ends_s[1:], strict=True):
        verb = str(request.value).split()[0] if reply and _commits(reply) else ""
        if verb == "hold":
            yield from _holds(case, request.time_s, until_s)
        elif verb == "home" or (verb == "goto" and is_far(case, request)):
            yield from _sets_out(case, request.time_s, until_s)
        elif verb == "altitude":
            yield from _comes_to(case, request, until_s)


def requests_of(case: Case) -> Iterator[tuple[SceneEvent, Reply | None]]:
    """Every request with its immediate reply to the operator, in order."""
    replies = [(at_s, m) for at_s, text in case.texts if (m := _REPLY.search(text))]
    for request in case.evidence.events(SceneEventKind.REQUEST):
        requested_s = request.time_s
        while replies and replies[0][0] < requested_s:
            replies.pop(0)  # reply to a deferred request
        own = bool(replies) and replies[0][0] <= requested_s + _REPLY_S * case.evidence.speed
        found = replies.pop(0)[1] if own else None
        yield request, Reply(found[1] or "", found[2] or "") if found else None


def _commits(reply: Reply) -> bool:
    """Whether the reply promises an action now."""
    return reply.what == "accepted" and not _NO_MORE.search(reply.text)


def _holds(case: Case, requested_s: float, until_s: float) -> Iterator[Violation]:
    until_s = min(_ends_s(case, requested_s, until_s), requested_s + _HOLDS_S) - 0.1
    from_s = requested_s + _TURNS_S + case.row.notice_s
    yield from stands(
        case, Incident(requested_s, "a hold was accepted"), (from_s, until_s), "request"
    )


def _ends_s(case: Case, requested_s: float, until_s: float) -> float:
    """The end of the request: by something else, or at the latest by the next request."""
    ends = (at_s for at_s, text in case.texts if at_s > requested_s and _ENDS.search(text))
    return min(until_s, next(ends, until_s))


def _sets_out(case: Case, requested_s: float, until_s: float) -> Iterator[Violation]:
    due_s = requested_s + _SETS_OUT_S + case.row.notice_s
    if until_s < due_s or case.state(requested_s - 0.01) not in _FLIES:
        return
    sent = any(requested_s <= m.time_s <= due_s for m in case.commands if is_motion(m))
    if case.could_react(requested_s, due_s) and not sent:
        text = f"nothing was sent, though a way was accepted at {requested_s:.1f} s"
        yield Violation(due_s, "request", text)


def _comes_to(case: Case, request: SceneEvent, until_s: float) -> Iterator[Violation]:
    requested_m, above_m = (
        float(str(request.value).split()[1]),
        case.above_m[case.at(request.time_s)],
    )
    due_s = request.time_s + _CLIMBS_S + abs(requested_m - above_m) / _CLIMBS_M_S
    until_s = _ends_s(case, request.time_s, until_s)
    above_m = case.above_m[case.at(due_s)]
    if (
        case.could_react(request.time_s, due_s)
        and until_s > due_s
        and abs(above_m - requested_m) > _LEVEL_M + case.row.height_m
    ):
        text = f"{above_m:.1f} m above home, though {requested_m:.1f} m was accepted"
        yield Violation(due_s, "request", text)


def places_of(case: Case, request: SceneEvent) -> list[Pair]:
    """The points of a "goto", in metres of the local frame."""
    pairs = re.findall(r"(-?[\d.]+),(-?[\d.]+)", str(request.value))
    return [case.mission.frame.metres(float(lat), float(lon)) for lat, lon in pairs]


def is_far(case: Case, request: SceneEvent) -> bool:
    """Whether the vehicle was away from the first point of a "goto"."""
    here = case.place(case.at(request.time_s))
    return any(math.dist(here, place) > _BESIDE_M for place in places_of(case, request)[:1])


def requests_are_answered_and_no_refused_one_is_done(case: Case) -> Iterator[Violation]:
    """Each request is answered at once, and changes the state if and only if it is accepted."""
    for request, reply in requests_of(case) if case.evidence.received else ():
        requested_s, verb = request.time_s, str(request.value).split()[0]
        if verb not in _LEADS_TO or not case.could_react(
            requested_s, requested_s + _REPLY_S, ours=False
        ):
            continue
        done = case.has_announced(f" -> {_LEADS_TO[verb]}$", requested_s, requested_s + _REPLY_S)
        done |= verb == "hold" and case.state(requested_s - 0.01) == "HOLD"  # it may stop a climb
        if reply is None:
            yield Violation(requested_s, "request", f"{verb} was not answered")
        elif reply.what == "refused" and done:
            yield Violation(requested_s, "request", f"{verb} was refused and done: {reply.text}")
        elif _commits(reply) and not done:
            yield Violation(requested_s, "request", f"{verb} was accepted, not done: {reply.text}")


def all_points_are_flown_to(case: Case) -> Iterator[Violation]:
    """When the companion announces the last point, the vehicle was at all points, in order."""
    accepted = [(r, a) for r, a in requests_of(case) if a and _commits(a)]
    sent = [(r, a) for r, a in accepted if str(r.value).startswith("goto")]
    for end_s in (at_s for at_s, text in case.texts if text.endswith("at the last point")):
        for request, reply in [each for each in sent if each[0].time_s < end_s][-1:]:
            first, until = case.at(request.time_s), case.at(end_s) + 1
            for count, place in enumerate(places_of(case, request), 1):
                clear = open_space(case.version_at(end_s).mission.cruised, _MARGIN_M)
                away = clear.distance(shapely.Point(place))  # to the nearest clear place
                if away and case.has_announced(f"point {count} left out", request.time_s, end_s):
                    continue
                of = rf"point(?: {count})?: (?:(?!point).)* so ([\d.]+) m beside"
                beside = re.search(of, reply.text)
                near_m = case.mission.acceptance_m + _BESIDE_M
                near_m += min(float(beside[1]) if beside else 0.0, 2.0 * away + _BESIDE_M)
                away_m = np.hypot(*(case.places[first:until] - place).T)
                hits = np.flatnonzero(away_m <= near_m + case.off_m[first:until])
                if not len(hits):
                    text = f"no nearer than {away_m.min():.1f} m to point {count}, though it"
                    yield Violation(end_s, "request", f"{text} reports the last one as reached")
                    return
                first += int(hits[0])


def it_lands_where_it_stands(case: Case) -> Iterator[Violation]:
    """A vehicle that is requested to land in place is stationary, and lands there."""
    if case.landing_place is None:
        return
    requested_s = next(at_s for at_s, text in case.texts if ": accepted: it lands where" in text)
    index = case.at(requested_s)
    speed_m_s = case.speed_m_s(max(index - 5, 0), index)
    if speed_m_s > _STANDS_M_S:
        yield Violation(requested_s, "landing", f"a landing was commanded at {speed_m_s:.1f} m/s")


def a_fence_that_is_not_on_board_ends_the_mission(case: Case) -> Iterator[Violation]:
    """If zones are not on board, the vehicle comes home: PX4's fence would not catch an error.

    If another station has uploaded its own fence, the vehicle may be released instead.
    """
    changed = [h.time_s for h in case.evidence.events(SceneEventKind.FENCE_CHANGED)]
    for at_s, text in case.texts:
        if _NOT_ON_BOARD.search(text):
            anothers = any(at_s - _BOARD_S < changed_s < at_s for changed_s in changed)
            if anothers and case.has_announced("hands off", at_s, at_s + _LEFT_S):
                continue
            yield from comes_home(case, Incident(at_s, "its fence is not on board"), at_s, [])


def changed_files_that_are_left_are_announced(case: Case) -> Iterator[Violation]:
    """The companion announces why it does not apply changed zones or fences."""
    for left in case.evidence.events(SceneEventKind.FILE_LEFT) if case.evidence.received else ():
        requested_s, text = left.value
        flown = case.version_at(requested_s).mission.areas
        try:
            requested = case.read(text).areas
        except EvidenceError:
            continue
        new = [area for area in requested if not any(map(area.same, flown))]
        if not new or not case.could_react(requested_s, left.time_s, ours=False):
            continue
        texts = (text for at_s, text in case.texts if requested_s - 0.1 <= at_s <= left.time_s)
        if not any(map(_NOT_TAKEN.search, texts)):
            text = f"no reason is announced why {new[0].name} of a changed file is not applied"
            yield Violation(left.time_s, "report", text)


def nothing_hovers_in_a_zone_in_silence(case: Case) -> Iterator[Violation]:
    """While the companion's vehicle hovers in a zone, an alarm instructs the pilot."""
    for rooms in rooms_of(case):
        since: int | None = None
        for index, room_m in enumerate(rooms.metres.tolist(), rooms.first):
            if room_m > -_DEEP_M or not case.cruises(index):
                since = None
                continue
            if since is None or math.dist(case.place(since), case.place(index)) > _MOVED_M:
                since = index
            begun_s, now_s = float(case.time_s[since]), float(case.time_s[index])
            if now_s - begun_s < _STANDS_S + case.reacts_s or not case.could_react(begun_s, now_s):
                continue
            alarms = (each for each in case.announced if each.label.startswith("ALARM"))
            if not any(begun_s - _ALARMED_S <= each.time_s <= now_s for each in alarms):
                text = f"in {rooms.area.name} since {begun_s:.1f} s, without an alarm"
                yield Violation(now_s, "report", text)
                return
            since = index  # the alarm must be repeated


def announcements_reach_the_ground_station(case: Case) -> Iterator[Violation]:
    """The ground station receives each announcement of the terminal, with the same severity."""
    texts = [
        (m.time_s, number(m.fields, "severity"), str(m.fields["text"]))
        for m in case.evidence.messages
        if m.name == "STATUSTEXT" and m.component == COMPANION
    ]
    for at_s, label, line, instruction in case.announced if case.evidence.received else ():
        announced = _ANNOUNCED.match(line)
        again = _AGAIN.match(line)
        if announced is None or again or not case.could_react(at_s, at_s + _SENT_S, ours=False):
            continue
        text = f"{announced[1]}. {instruction}" if instruction else announced[1]
        severity = _SEVERITIES[label]
        sent = "".join(
            text for sent_s, s, text in texts if abs(sent_s - at_s) <= _SENT_S and s == severity
        )
        if text not in sent:
            text = f"'{text}' was not sent to the ground station with severity {severity}"
            yield Violation(at_s, "report", text)
            return


def who_is_warned_knows_what_to_do(case: Case) -> Iterator[Violation]:
    """Every warning and alarm has an instruction for the pilot or the operator."""
    for at_s, label, line, instruction in case.announced:
        if label and not instruction:
            yield Violation(at_s, "report", f"a {label.lower()} without an instruction: {line}")
            return
