"""What the judge accepts of a flight, one row per fault; every row can be read aloud.

A flight with two faults may end as either of them may, and is excused what both excuse.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum
from functools import reduce
from types import MappingProxyType
from typing import Final

from sitl.rehearsal.judge.evidence import EvidenceError


class End(Enum):
    """How a flight ended."""

    LANDED = "landed at home"
    ON_REQUEST = "landed where requested"
    PILOT = "held or landed by the pilot"
    FAILSAFE = "in the autopilot's failsafe"
    HOVERS = "hovers where its last leg ended"
    STAYED = "stayed on the ground"
    ELSEWHERE = "landed away from home"
    FELL = "fell"
    NOT = "did not end"


@dataclass(frozen=True, slots=True)
class Row:
    """What is accepted when something goes wrong.

    Attributes:
        ends: How the flight may end.
        room_m: So much less than the clearance may be kept.
        height_m: So much higher or lower than the plan's band may be flown.
        home_m: So much farther from home may be landed.
        notice_s: How much longer than usual the companion has to notice that it was taken over.
        announcement: A pattern that one of its lines has to match; empty: no line is needed.
        shows_s: It has to be announced if the vehicle cruised with it for so long; else always.
        explores: It has the time to visit every waypoint.
    """

    ends: frozenset[End]
    room_m: float = 0.0
    height_m: float = 0.0
    home_m: float = 0.0
    notice_s: float = 0.0
    announcement: str = ""
    shows_s: float = 0.0
    explores: bool = False

    def with_(self, other: Row) -> Row:
        """What is accepted when both happen: what either may end as, and all that is excused."""
        return Row(
            self.ends | other.ends,
            self.room_m + other.room_m,
            self.height_m + other.height_m,
            self.home_m + other.home_m,
            max(self.notice_s, other.notice_s),
        )


def _row(*ends: End, **more: object) -> Row:
    return Row(frozenset(ends), **more)  # type: ignore[arg-type]


_HOME: Final = _row(End.LANDED)
_HOME_OR_FAILSAFE: Final = _row(End.LANDED, End.FAILSAFE)
_PILOTS: Final = _row(End.PILOT, announcement="pilot|ground station|taken|took")
_HEIGHT_OFF: Final = _row(
    *(End.LANDED, End.FAILSAFE, End.PILOT),
    height_m=4.0,  # until the satellites' altitude shows it
    announcement="altitude|height|high",
    shows_s=3.0,
)

ACCEPTED: Final = MappingProxyType(
    {
        # It comes home: where the estimate is off, the scene notes by how much, and excuses that;
        # sticks that override nothing are nothing to the autopilot; no message of robots or
        # strangers moves or ends a flight; nothing comes of a stream that is gone for a moment.
        **dict.fromkeys(
            (
                *("NONE", "JUMPS", "LOSS_1", "SILENCE", "BUSY", "BRIEF_STREAM", "LOST_BATTERY"),
                *("LOST_FIX", "LOST_LANDED", "STICKS_ONLY", "RESTART", "STOPPED", "MOVED_LINK"),
                *(
                    "VANISH",
                    "MAD_ROBOTS",
                    "ONE_DEAD",
                    "HOSTILE",
                    "TWO_VEHICLES",
                    "FOREIGN",
                    "RELOAD",
                ),
                *("REQUESTS", "ZONE_ACROSS", "ZONE_IN_HASTE", "CORNERS"),
                *("FAST_CORNERS", "NEARED"),
                *("WEAK_LINKS", "GOALS"),
            ),
            _HOME,
        ),
        "JUMPING_POSES": _row(End.LANDED, announcement="the position of [a-z]+ jumped .*: ignored"),
        # Unusual values are read correctly, false ones are not believed, requests are carried out.
        **dict.fromkeys(
            (
                *("LOCAL_METRES", "WINDY", "ZONE_MOVED", "STALE", "PAST_ALL", "MAP_FILES"),
                *("FORGED", "CLAIMS", "FILE_CHANGED", "POSES_CARRIED"),
            ),
            _HOME,
        ),
        "DAILY_HOURS": _row(End.LANDED, explores=True),
        "ALTERED_LISTS": _row(End.LANDED, End.STAYED),
        "FENCE_MOVED": _row(End.LANDED, End.PILOT, notice_s=3.0, announcement="fence|plan"),
        "RESUMED_AMONG": _row(End.LANDED, End.HOVERS),
        "RESUMED_BLIND": _row(End.LANDED, explores=True),
        "LANDED_AT": _row(End.LANDED, End.ON_REQUEST),
        "SECOND_UAV": _row(End.LANDED, End.ON_REQUEST),
        # It may stay: the autopilot's own return would climb into the layer above.
        "LAYERS_REDRAWN": _row(End.LANDED, End.STAYED),
        "LOW_AMONG_LAYERS": _row(End.LANDED, End.PILOT, End.STAYED),
        # It lands late, but it lands: what was lost is commanded again.
        "LANDING_LOST": _row(End.LANDED, notice_s=50.0),
        "ASKED_EVERYWHERE": _row(End.LANDED, End.ON_REQUEST),
        "ASKED_IN_IDLE": _HOME,
        "NO_FIX_IDLE": _HOME_OR_FAILSAFE,
        # Nothing goes wrong: requests are carried out, or a way home not called off.
        "SENT": _HOME,
        "EXPLORED": _row(End.LANDED, explores=True),
        "IDLE": _row(End.LANDED, explores=True),
        "ALTITUDES": _HOME,
        "ZONE_BELOW": _row(End.LANDED, End.ON_REQUEST, End.PILOT),
        "LANDED_HERE": _row(End.LANDED, End.ON_REQUEST),
        "ENDURANCE": _HOME,
        "BATTERY_DROPS": _HOME,
        "BATTERY_GLITCH": _HOME,  # not for that: `a_moment_of_no_charge_ends_nothing`
        "HOME_FOR_GOOD": _row(End.LANDED, height_m=5.0),  # its altitude may drift, as BAROMETER's
        # The weather and the estimate.
        "GUSTS": _row(End.LANDED, home_m=2.0),
        "STORM": _row(*End, room_m=30.0, height_m=10.0, home_m=60.0),
        # Pushed over the border it is the autopilot's, or released; pushed near, that is announced.
        "PUSHED": _row(*(End.LANDED, End.FAILSAFE, End.PILOT), room_m=8.0, home_m=2.0),
        "DRIFT": _HOME_OR_FAILSAFE,
        "ALTITUDE_JUMPS": _HEIGHT_OFF,
        # It drifts by up to 9 m; it comes home, and may be on its way there already.
        "BAROMETER": replace(_HEIGHT_OFF, height_m=5.0, shows_s=20.0),
        # The link: it comes home, or stays where its plan did not get on board.
        "LOSS_5": _row(End.LANDED, End.STAYED),  # it arms once: that may be lost
        "LOSS_20": _row(End.LANDED, End.STAYED, notice_s=3.0),
        "BURSTS": _row(End.LANDED, End.STAYED, notice_s=3.0),
        # Late messages may resemble a pilot's, who does not know then that the vehicle is his.
        "LATE": _row(End.LANDED, End.PILOT, End.NOT, notice_s=4.0),
        "OLD": _row(End.LANDED, End.PILOT, notice_s=2.0),
        "NO_FIX": _HOME_OR_FAILSAFE,
        "POOR_FIX": _HOME,
        "SATELLITES_GONE": _HOME_OR_FAILSAFE,  # it may be landing already
        "STICKS_LOST": _HOME_OR_FAILSAFE,
        "UPLOAD": _row(End.LANDED, End.STAYED),
        "ALTERED": _row(End.LANDED, End.STAYED),
        "BY_HAND": _row(End.PILOT, announcement="is not on board"),
        "MISPLACED": _row(
            *(End.LANDED, End.PILOT, End.FAILSAFE), announcement="Mission was chosen low and away"
        ),
        "OTHER_AUTOPILOT": _row(End.STAYED, announcement="not PX4"),
        "WRONG_VEHICLE": _row(End.STAYED, announcement="multicopter"),
        "TWINS": _row(End.PILOT, End.FAILSAFE, notice_s=3.0, announcement="two autopilots"),
        "TYPE_CHANGES": _row(End.PILOT, End.LANDED, End.STAYED, announcement="multicopter"),
        "READY_TAKEN": _row(End.STAYED, End.PILOT, announcement="pilot"),
        # One message stream alone, for ever: it holds, or commands nothing, until the pilot or a
        # battery failsafe ends it. The announcement it needs, and when, is in `inputs`.
        "LOST_POSITION": _row(End.LANDED, End.HOVERS, End.FAILSAFE, End.NOT),
        "BLIND_AND_EMPTY": _row(End.LANDED, End.HOVERS, End.FAILSAFE, End.NOT),
        "WRONG_FIX": _row(End.LANDED, End.NOT),  # one that comes and goes is held for
        "LOST_ITEM": _row(End.LANDED, End.NOT),  # a wrong one is another's choice: hands off
        "LOST_MODE": _row(End.LANDED, End.HOVERS, End.FAILSAFE, End.NOT),
        # The pilot and other stations: the vehicle is theirs, and that is announced.
        "PILOT": _PILOTS,
        "HAND_BACK": _row(End.LANDED, End.PILOT),
        "ZONES_TAKEN": _row(End.LANDED, End.PILOT),
        "ZONE_OVER_TAKEN": _row(End.PILOT, announcement="breach"),
        "HANDED_BACK_LOW": _row(End.LANDED, End.PILOT),
        "HANDED_BACK_MOVING": _row(End.LANDED, End.PILOT),
        "ZONE_ABOVE": _row(End.LANDED, End.PILOT),
        # A zone drawn into a landing is a breach: hands off, and the pilot takes it.
        "ZONE_AT": _row(End.LANDED, End.ON_REQUEST, End.PILOT),
        "HANDED_BACK_HIGH": _row(End.LANDED, End.PILOT),
        "TAKEN_IN_HASTE": _PILOTS,
        "HELD_IN_HASTE": _PILOTS,
        "LAYERS": _row(End.LANDED, End.PILOT),
        "RESTART_TAKEN": _row(End.LANDED, End.PILOT),
        "SILENCE_TAKEN": _row(End.LANDED, End.PILOT),
        "CHOSEN_BACK": _row(End.PILOT, announcement="pilot"),
        "STALL_TAKEN": _row(End.LANDED, End.PILOT),
        "PAUSE": _row(End.PILOT, End.FAILSAFE, notice_s=2.0),
        "LEFT_BEHIND": _row(End.LANDED, End.PILOT, notice_s=3.0),
        "DOUBTED": _row(End.LANDED, End.PILOT, height_m=9.0),
        "DOUBTED_AMONG": _row(End.LANDED, height_m=9.0, announcement="altitude is in doubt"),
        "DOUBTED_WALLED": _row(
            End.LANDED, height_m=9.0, announcement="clear of zones by PX4's altitude alone"
        ),
        "DIVERTED_CLOSE": _row(End.PILOT, End.FAILSAFE, End.LANDED, notice_s=2.0),
        "DIVERTED_WAITING": _row(End.PILOT, End.LANDED, End.FAILSAFE, notice_s=2.0),
        "DIVERTED": _row(End.PILOT, notice_s=2.0, announcement="another place|pilot"),
        "STICKS": _row(End.LANDED, End.PILOT, notice_s=2.0),
        "PLAN_DELETED": _row(End.LANDED, End.PILOT, notice_s=3.0, announcement="plan|mission"),
        "FENCE_DELETED": _row(End.LANDED, End.PILOT, notice_s=3.0, announcement="fence|plan"),
        "PLAN_REPLACED": _row(
            *(End.LANDED, End.PILOT), notice_s=3.0, announcement="plan on board was|another plan is"
        ),
        "PLAN_IN_RENEWAL": _row(
            *(End.LANDED, End.PILOT), notice_s=3.0, announcement="plan on board was|another plan is"
        ),
        "LIST_AMONG_OURS": _row(
            *(End.LANDED, End.STAYED, End.PILOT),
            notice_s=3.0,
            announcement="another ground station has changed|plan on board was|"
            "another plan is|fence|rally",
        ),
        "PLAN_AT_START": _row(
            *(End.LANDED, End.STAYED, End.PILOT),
            notice_s=3.0,
            announcement="plan on board|another plan",
        ),
        "START_LOST": _row(
            *(End.LANDED, End.STAYED, End.PILOT),
            notice_s=3.0,
            announcement="plan on board|another plan",
        ),
        "RESTARTED_ON_ANOTHER": _row(End.LANDED, End.PILOT),
        "SAME_PLAN": _row(End.LANDED, End.PILOT, notice_s=3.0, announcement="plan|mission"),
        "ZONE": _row(End.PILOT, End.LANDED, notice_s=3.0, announcement="fence|plan"),
        "HOME_MOVED": _row(End.LANDED, End.HOVERS, End.PILOT, End.STAYED, announcement="home"),
        "SPEED": _row(End.LANDED, announcement="speed|fast|m/s"),
        "DISARMED": _row(End.STAYED, End.PILOT, announcement="disarm"),
        "KILLED_IN_AIR": _row(End.FELL, announcement="disarm|kill|motors"),
        "TWO_STATIONS": _row(End.PILOT, End.LANDED, notice_s=3.0),
        # The companion and the autopilot themselves.
        "KILL": _row(End.HOVERS),
        "REBOOT": _row(*End, announcement="reboot|restart|start|silent|anew"),
        "BATTERY": _HOME_OR_FAILSAFE,  # where home could not be reached in time
        "BATTERY_LIES": _HOME_OR_FAILSAFE,
        "REFUSED": _HOME_OR_FAILSAFE,  # the fence on board may be none of ours
        "WALL": _HOME_OR_FAILSAFE,  # walled in for good it hovers until the battery's failsafe
    }
)


def accepted(faults: Iterable[str]) -> Row:
    """The row of a flight's faults together.

    Raises:
        EvidenceError: one of them has none.
    """
    rows = [ACCEPTED.get(fault) for fault in sorted(faults) if fault != "TWO"] or [_HOME]
    known = [row for row in rows if row is not None]
    if len(known) < len(rows):
        raise EvidenceError(f"acceptance.py has no row for {sorted(faults)}")
    return reduce(Row.with_, known)
