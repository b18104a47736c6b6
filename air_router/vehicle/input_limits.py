"""What follows when one input is missing while the vehicle says other things: one table.

Pure: ages come with the telemetry, the time with the event.
"""

import math
from dataclasses import dataclass, field
from enum import Enum
from operator import attrgetter, lt
from typing import Final, NamedTuple

from air_router.vehicle.instructions import (
    CHECK_LINK,
    CHECK_STREAMS,
    TAKE_OVER_BLIND,
    WATCH_BATTERY,
    Instruction,
)
from air_router.vehicle.limits import FIX_ALARM_S, FLIGHT_MODE_S, INPUT_BACK_S, INPUT_REPEATED_S
from air_router.vehicle.vehicle import Telemetry

NO_FIX: Final = "GPS has no fix"


class InputResponse(Enum):
    """What is done about the flight while an input is missing for too long."""

    NONE = "the mission goes on"
    HOLD = "holding"
    SILENT = "nothing is commanded"


@dataclass(frozen=True, slots=True)
class InputLimit:
    """One row of the table; times in seconds on the vehicle's clock.

    Attributes:
        words: What is missing, for pilots.
        message: In which MAVLink messages it comes.
        age: The field of `Ages` that counts it.
        announce_s: It is announced.
        stop_s: No leg begins any more, and what `stop` says is done; None: never.
        home_s: The mission ends; None: never.
        home_without: Home is flown though it is still missing.
        instruction: What the pilot or the operator does.
        why: Why so.
    """

    words: str
    message: str
    age: str
    announce_s: float
    home_s: float | None
    instruction: Instruction
    why: str
    stop: InputResponse = InputResponse.NONE
    stop_s: float | None = None
    home_without: bool = True

    def ends(self, age_s: float) -> bool:
        """Whether the mission ends for it."""
        return self.home_s is not None and age_s >= self.home_s

    def stop_at(self, age_s: float) -> InputResponse:
        """What is done at this age."""
        if self.stop_s is None or age_s < self.stop_s:
            return InputResponse.NONE
        return InputResponse.NONE if self.home_without and self.ends(age_s) else self.stop

    def then(self, age_s: float) -> str:
        """What is done, or comes next, as text."""
        stop = self.stop_at(age_s)
        if stop is not InputResponse.NONE:
            return str(stop.value)
        if self.ends(age_s):
            return "the mission ends"
        if self.stop_s is not None:
            return f"{self.stop.value} at {self.stop_s:.0f} s"
        return f"coming home at {self.home_s:.0f} s"


LIMITS: Final = (
    InputLimit(
        "position",
        "GLOBAL_POSITION_INT",
        "position_s",
        announce_s=2.0,
        stop=InputResponse.HOLD,
        stop_s=2.0,
        home_s=30.0,
        home_without=False,
        instruction=TAKE_OVER_BLIND,
        why="legs are checked from the vehicle's position; it comes home once that is known again",
    ),
    InputLimit(
        "flight mode",
        "HEARTBEAT, CURRENT_MODE",
        "mode_s",
        announce_s=FLIGHT_MODE_S,
        stop=InputResponse.SILENT,
        stop_s=FLIGHT_MODE_S,
        home_s=None,
        instruction=CHECK_LINK,
        why="a pilot may have taken the vehicle",
    ),
    InputLimit(
        "heartbeat",
        "HEARTBEAT",
        "armed_s",
        announce_s=5.0,
        home_s=30.0,
        instruction=CHECK_STREAMS,
        why="disarming and failsafes are not visible; on the ground it counts as disarmed",
    ),
    InputLimit(
        "GPS status",
        "GPS_RAW_INT",
        "fix_s",
        announce_s=5.0,
        stop=InputResponse.HOLD,
        stop_s=10.0,
        home_s=30.0,
        instruction=TAKE_OVER_BLIND,
        why="the fix may be lost; it comes home by the positions, which still arrive",
    ),
    InputLimit(
        "battery",
        "SYS_STATUS",
        "battery_s",
        announce_s=5.0,
        home_s=30.0,
        instruction=WATCH_BATTERY,
        why="the reserve cannot be monitored",
    ),
    InputLimit(
        "plan item",
        "MISSION_CURRENT",
        "item_s",
        announce_s=5.0,
        home_s=60.0,
        instruction=CHECK_STREAMS,
        why="MISSION_SET_CURRENT is not confirmed: after four, legs are flown by DO_REPOSITION",
    ),
    InputLimit(
        "landed state",
        "EXTENDED_SYS_STATE",
        "landed_s",
        announce_s=5.0,
        home_s=60.0,
        instruction=CHECK_STREAMS,
        why="armed and 5 m above home it counts as in the air, disarmed as on the ground",
    ),
)
"""Every input that a flight rests on; the most severe first."""

INPUT_ALARMS: Final = frozenset({NO_FIX, *(f"{limit.words} not heard" for limit in LIMITS)})
"""What is alarmed of while it stops the vehicle."""

_ages = attrgetter(*(limit.age for limit in LIMITS))
_ANNOUNCE_S: Final = tuple(limit.announce_s for limit in LIMITS)
"""From which age on an input is missing at all; the other limits are no lower."""


class InputAnnouncement(NamedTuple):
    """What to announce.

    Attributes:
        what: Is missing, or is back.
        then: What is done about it; empty: nothing.
        instruction: What the pilot or the operator does; None: it is back.
        alarms: The pilot has to act now: the vehicle waits for it.
        about: What is alarmed of, as in `InputWatch.stopped`.
        age_s: For how long it has been missing.
    """

    what: str
    then: str
    instruction: Instruction | None = None
    alarms: bool = False
    about: str = ""
    age_s: float = 0.0


class InputStatus(NamedTuple):
    """What the inputs allow now.

    Attributes:
        stop: What is done meanwhile, and `why`.
        back: Legs may begin again, just now.
        home_why: Why the mission ends, if it does for that.
        announcements: What to announce.
    """

    stop: InputResponse
    why: str
    back: bool
    home_why: str | None
    announcements: tuple[InputAnnouncement, ...]


INPUTS_NOMINAL: Final = InputStatus(
    InputResponse.NONE, "", back=False, home_why=None, announcements=()
)


@dataclass(slots=True, eq=False)
class InputWatch:
    """Checks the ages in every telemetry update, and at whether GPS has a fix.

    Attributes:
        stopped: What no leg begins without, and is missing or not back for long enough.
        silent: Nothing is commanded meanwhile: a pilot may have taken the vehicle.
    """

    stopped: dict[str, InputResponse] = field(default_factory=dict)
    silent: bool = False
    # by what is missing: announced, when
    _announced: dict[str, tuple[bool, float]] = field(default_factory=dict)
    _good_since_s: float | None = None  # since when the fix is good again
    _no_fix_since_s: float = 0.0  # since when it has none, as announced
    _alarmed_of_fix: bool = False  # of this loss

    def update(self, telemetry: Telemetry) -> InputStatus:
        """Take the next telemetry in."""
        waits = not telemetry.fix or self.stopped or self._announced
        if not waits and all(map(lt, _ages(telemetry.ages), _ANNOUNCE_S)):
            return INPUTS_NOMINAL
        missing: dict[str, InputResponse] = {}
        announcements: list[InputAnnouncement] = []
        home_why = None
        if not telemetry.fix:
            missing[NO_FIX] = InputResponse.HOLD
            announcements += self._announce_fix(telemetry.received_s)
        stopped = tuple(self.stopped)
        for limit in LIMITS:
            age_s = getattr(telemetry.ages, limit.age)
            words = f"{limit.words} not heard"
            if limit.ends(age_s):
                home_why = home_why or f"{words} for {age_s:.0f} s"
            stop = limit.stop_at(age_s)
            if stop is not InputResponse.NONE:
                missing[words] = stop
            elif age_s >= limit.announce_s:
                self.stopped.pop(words, None)  # home is flown without it
            announcements += self._announce_missing(limit, age_s, telemetry.received_s)
        back = self._back(missing, telemetry.received_s) and bool(stopped)
        if back and home_why is None:
            fix = "GPS has its fix again" if NO_FIX in stopped else "all of it is heard again"
            announcements.append(InputAnnouncement(fix, "going on"))
        self.silent = InputResponse.SILENT in self.stopped.values()
        stop = (
            InputResponse.SILENT
            if self.silent
            else InputResponse.HOLD
            if self.stopped
            else InputResponse.NONE
        )
        why = next(iter(missing), next(iter(self.stopped), ""))
        return InputStatus(stop, why, back, home_why, tuple(announcements))

    def _back(self, missing: dict[str, InputResponse], now_s: float) -> bool:
        """Whether nothing stops it any more: what did has come again for some time."""
        if missing or not self.stopped:
            self._good_since_s = None
            self.stopped.update(missing)
            return not missing
        if self._good_since_s is None:
            self._good_since_s = now_s
        if now_s - self._good_since_s < INPUT_BACK_S:
            return False
        self.stopped.clear()
        return True

    def _announce_missing(
        self, limit: InputLimit, age_s: float, now_s: float
    ) -> list[InputAnnouncement]:
        """At once, when it stops the vehicle, and now and then; and when it comes again."""
        if age_s < limit.announce_s:
            announced = self._announced.pop(limit.words, None)
            back = InputAnnouncement(
                f"{limit.words} heard again", "", about=f"{limit.words} not heard"
            )
            return [back] if announced else []
        stops = limit.stop_at(age_s) is not InputResponse.NONE
        before, announced_s = self._announced.get(limit.words, (False, -math.inf))
        again = limit.words in self._announced
        # What stops the vehicle is an alarm, which is repeated by itself.
        if stops <= before and (stops or now_s < announced_s + INPUT_REPEATED_S):
            return []
        self._announced[limit.words] = (stops or before, now_s)
        return [
            InputAnnouncement(
                f"{limit.words} not heard for {age_s:.0f} s",
                limit.then(age_s) if stops > before or not again else "",
                limit.instruction,
                alarms=stops,
                about=f"{limit.words} not heard",
                age_s=age_s,
            )
        ]

    def _announce_fix(self, now_s: float) -> list[InputAnnouncement]:
        """That it is lost, at once; as an alarm where it does not come back soon."""
        if NO_FIX not in self.stopped:
            self._no_fix_since_s, self._alarmed_of_fix = now_s, False
            return [
                InputAnnouncement("GPS has lost its fix", InputResponse.HOLD.value, TAKE_OVER_BLIND)
            ]
        age_s = now_s - self._no_fix_since_s
        if self._alarmed_of_fix or age_s < FIX_ALARM_S:
            return []
        self._alarmed_of_fix = True
        what = f"GPS has no fix for {age_s:.0f} s"
        instruction = TAKE_OVER_BLIND
        return [
            InputAnnouncement(
                what, InputResponse.HOLD.value, instruction, alarms=True, about=NO_FIX, age_s=age_s
            )
        ]
