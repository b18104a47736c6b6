"""The judge's ear on the wire: what the companion commanded, and whether it might."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import shapely

from sitl.rehearsal.judge.acceptance import Tolerance
from sitl.rehearsal.judge.evidence import AUTOPILOT, SceneEventKind, WireMessage
from sitl.rehearsal.judge.judge_plan import PlanJudge
from sitl.rehearsal.judge.judge_space import (
    DRIFT_M,
    areas_in_force,
    room_m,
    straight_room_m,
)
from sitl.rehearsal.judge.judge_track import (
    Judge,
    Responsible,
    command_of,
    is_motion,
    number,
)
from sitl.rehearsal.judge.mission_reader import Pair

ARM, SPEED, REPOSITION, SET_HOME, RETURN, TERMINATE = 400, 178, 192, 179, 20, 185  # MAV_CMD
_NEVER: Final = frozenset({SET_HOME, RETURN, TERMINATE, 16, 17, 22, 34, 252})
_NOWHERE: Final = 2**31 - 1
_ON_BOARD_M: Final = 3.0
"""How far the vehicle's own idea of mean sea level may be off."""

_LEG_M: Final = 1.0
"""How far a vehicle may be from where it told us that it is, without any fault."""

_TWICE_S, _PLACE_TWICE_S = 0.9, 0.03
"""So soon after it left nothing can be known of a command: it does not leave again as it was. What
leads to a place may be decided anew with the next position, which a link may bring soon after."""

_SHOWS_LATER_S: Final = 1.0
_UNSHOWN: Final = frozenset({"item", "reposition", "plan"})
"""A pilot's choices that no mode shows: where the vehicle goes does, a second later."""

_RENEWS_S: Final = 1.0
"""What is drawn across the way is held for, or flown around, within so long."""

_READ_S: Final = 0.3
"""A changed file counts for the companion so long before the scene says so, at most."""

_REPEATS_S: Final = 5.0
_FRESH_S: Final = 0.6
"""A repeat needs a HEARTBEAT that is no older."""


@dataclass(slots=True)
class WireJudge(Judge):
    """Judges the commands of one flight.

    Attributes:
        tolerance: What the flight's faults excuse.
        notice_s: How much longer than usual it takes to notice a pilot.
        legs: The commands that lead to a place.
    """

    tolerance: Tolerance
    notice_s: float
    legs: list[WireMessage] = field(default_factory=list)
    _hearts: list[WireMessage] = field(default_factory=list)

    def judge(self) -> None:
        """Listen to the whole flight."""
        track = self.track
        self._hearts = [
            m
            for m in track.evidence.messages
            if m.name == "HEARTBEAT" and m.component == AUTOPILOT and m.delivered
        ]
        plan = PlanJudge(track)
        plan.judge()
        self.violations += plan.violations
        armed = [s.time_s for s in track.evidence.samples if s.armed]
        disarmed = [h.time_s for h in track.evidence.told(SceneEventKind.DISARMED)]
        if armed:
            later = (s.time_s for s in track.evidence.samples if s.time_s > armed[0])
            gone = next((at for at in later if not self._armed(at)), math.inf)
            disarmed.append(gone)
        for message in track.commands():
            self._judge(message, min(disarmed, default=math.inf))
            target = self._target(message, plan)
            if target is not None:
                self.legs.append(message)
                self._judge_leg(message, target)
        self._judge_repeats()
        self._judge_renewals(plan)

    def _armed(self, time_s: float) -> bool:
        return self.track.evidence.samples[self.track.at(time_s)].armed

    def _judge(self, message: WireMessage, disarmed_s: float) -> None:
        track, fields, command = self.track, message.fields, command_of(message)
        flying = bool(track.flying[track.at(message.time_s)])
        arms = command == ARM and number(fields, "param1") == 1.0
        words = f"{message.name} {command}" if command is not None else message.name
        if _commands(message):
            self._judge_authority(message, words)
        if command == ARM and not arms and flying:
            self.add(message.time_s, "disarm", "disarmed in the air")
        if arms and message.time_s > disarmed_s:
            self.add(message.time_s, "rearm", f"armed after it was disarmed at {disarmed_s:.1f} s")
        stray = message.name in {"MANUAL_CONTROL", "PARAM_SET"} and flying
        if command in _NEVER or stray or message.name.startswith("SET_POSITION_TARGET"):
            self.add(message.time_s, "stray", f"{words} is no command of ours")
        speed_m_s = number(fields, "param2" if command == SPEED else "param1")
        limit_m_s = track.version_at(message.time_s).mission.speed_m_s + 0.1
        if command in {SPEED, REPOSITION} and speed_m_s > limit_m_s:
            text = f"{speed_m_s:.1f} m/s, the plan says {limit_m_s:.1f}"
            self.add(message.time_s, "speed", text, speed_m_s, limit_m_s)
        if command == REPOSITION:
            self._judge_height(message, number(fields, "z" if "z" in fields else "param7"))

    def _judge_height(self, message: WireMessage, amsl_m: float) -> None:
        altitudes_m = self.track.version_at(message.time_s).mission.altitudes_m
        above_m = amsl_m - self.track.ground_m
        slack_m = _ON_BOARD_M + self.tolerance.height_m
        if above_m < min(altitudes_m) - slack_m or above_m > max(altitudes_m) + slack_m:
            text = f"sent to {above_m:.1f} m, the plan flies {altitudes_m[0]:.1f} m"
            self.add(message.time_s, "height", text, above_m, altitudes_m[0])

    def _judge_authority(self, message: WireMessage, words: str) -> None:
        for begin_s, end_s, by in self.track.given:
            if not begin_s < message.time_s < end_s:
                continue
            known_s = next((h.time_s for h in self._hearts if h.time_s > begin_s), math.inf)
            known_s += self.track.evidence.reaction_s + self.notice_s
            told = (
                h for h in self.track.evidence.told(SceneEventKind.PILOT) if h.time_s == begin_s
            )
            known_s += _SHOWS_LATER_S if any(h.value in _UNSHOWN for h in told) else 0.0
            if message.time_s > known_s:
                text = f"{words} while the vehicle is {by} since {begin_s:.1f} s"
                self.add(message.time_s, "authority", text)
                return

    def _judge_repeats(self) -> None:
        """The same twice; and again over a choice, not having heard that nothing was chosen."""
        commands = [m for m in self.track.commands() if _commands(m)]
        for before, message in pairwise(commands):
            seconds = message.time_s - before.time_s
            led = message.name == "MISSION_SET_CURRENT" or command_of(message) == REPOSITION
            least_s = _PLACE_TWICE_S if led else _TWICE_S
            if seconds < least_s and _plain(before) == _plain(message):
                self.add(
                    message.time_s, "repeat", f"{message.name} left twice within {seconds:.2f} s"
                )
        sent = [m for m in commands if is_motion(m)]
        choices = [h.time_s for h in self.track.evidence.told(SceneEventKind.PILOT)]
        for later, message in enumerate(sent):
            for before in sent[:later]:
                again = _same(before, message) and message.time_s - before.time_s < _REPEATS_S
                chosen = any(before.time_s < at_s < message.time_s for at_s in choices)
                heard = [h.time_s for h in self._hearts if h.time_s <= message.time_s]
                fresh_s = _FRESH_S + self.track.evidence.reaction_s + self.notice_s
                if again and chosen and message.time_s - max(heard, default=0.0) > fresh_s:
                    self.add(message.time_s, "repeat", f"{message.name} sent again over a choice")

    def _target(self, message: WireMessage, plan: PlanJudge) -> Pair | None:
        """Where a command leads to, in metres."""
        fields = message.fields
        if message.name == "MISSION_SET_CURRENT":
            return plan.place(int(fields["seq"]), message.time_s)
        if command_of(message) != REPOSITION:
            return None
        if "x" in fields:
            if int(fields["x"]) == _NOWHERE:
                return None
            latitude, longitude = fields["x"] / 1e7, fields["y"] / 1e7
        else:
            latitude, longitude = number(fields, "param5"), number(fields, "param6")
        if not (math.isfinite(latitude) and math.isfinite(longitude)):
            return None
        east, north = self.track.mission.frame.metres(latitude, longitude)
        return float(east), float(north)

    def _judge_leg(self, message: WireMessage, target: Pair) -> None:
        """What it sweeps from where it is, while it brakes; one that is too near may get away."""
        track = self.track
        index = track.at(message.time_s)
        if not track.flying[index]:
            return
        short = self._falls_short(index, message.time_s, target)
        if short is not None:
            text, kept_m, limit_m = short
            self.add(message.time_s, "leg", f"a leg that {text}", kept_m, limit_m)

    def _judge_renewals(self, plan: PlanJudge) -> None:
        """A leg under way across what a changed file has drawn there is not flown on."""
        track = self.track
        motions = [m for m in track.commands() if is_motion(m)]
        for version in track.versions[1:]:
            index = track.at(version.from_s)
            end_s = version.from_s + _RENEWS_S + track.evidence.reaction_s + self.notice_s
            told = [m for m in motions if m.delivered and m.time_s < version.from_s - _READ_S]
            at_once = [m for m in motions if version.from_s - _READ_S <= m.time_s <= end_s]
            ours = set(track.by[index : track.at(end_s) + 1]) == {Responsible.OURS}
            target = self._target(told[-1], plan) if told else None
            stands = math.dist(track.rest(index), (track.east_m[index], track.north_m[index])) < 0.2
            if target is None or at_once or stands or not ours or not track.flying[index]:
                continue
            short = self._falls_short(index, version.from_s, target)
            if short is not None:
                text, kept_m, limit_m = short
                words = f"a leg is flown on, and nothing commanded, that now {text}"
                self.add(version.from_s, "leg", words, kept_m, limit_m)

    def _falls_short(
        self, index: int, time_s: float, target: Pair
    ) -> tuple[str, float, float] | None:
        """How what is swept of a leg from a sample on is too near to something; None: it is not."""
        track = self.track
        here = float(track.east_m[index]), float(track.north_m[index])
        rest = track.rest(index)
        swept = shapely.MultiPoint([here, rest, target]).convex_hull
        height_m = float(track.above_m[index]) + track.ground_m
        for area, fence in areas_in_force(track.version_at(time_s)):
            if not area.lower_m <= height_m <= area.upper_m:
                continue
            kept_m = room_m(area, swept, fence=fence)
            now_m = straight_room_m(area, here, rest, fence=fence)
            slack_m = _LEG_M + self.tolerance.room_m + float(track.off_m[index])
            limit_m = min(area.clearance_m - slack_m, now_m - DRIFT_M)
            if kept_m < limit_m:
                text = f"keeps {kept_m:.2f} m of {area.name}, not {limit_m:.2f} m"
                return text, kept_m, limit_m
        return None


def _commands(message: WireMessage) -> bool:
    """Whether a message arms, moves, or changes a speed."""
    return command_of(message) in {ARM, SPEED} or is_motion(message)


def _plain(message: WireMessage, *but: str) -> dict[str, str]:
    """A message as text, in which what is not a number is equal to itself."""
    fields = {name: repr(value) for name, value in message.fields.items() if name not in but}
    return {"": message.name, **fields}


def _same(one: WireMessage, other: WireMessage) -> bool:
    return _plain(one, "confirmation") == _plain(other, "confirmation")
