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


class Stop(Enum):
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
        told_s: It is announced.
        stop_s: No leg begins any more, and what `stop` says is done; None: never.
        home_s: The mission ends; None: never.
        home_without: Home is flown though it is still missing.
        instruction: What the pilot or the operator does.
        why: Why so.
    """

    words: str
    message: str
    age: str
    told_s: float
    home_s: float | None
    instruction: Instruction
    why: str
    stop: Stop = Stop.NONE
    stop_s: float | None = None
    home_without: bool = True

    def ends(self, age_s: float) -> bool:
        """Whether the mission ends for it."""
        return self.home_s is not None and age_s >= self.home_s

    def stop_at(self, age_s: float) -> Stop:
        """What is done at this age."""
        if self.stop_s is None or age_s < self.stop_s:
            return Stop.NONE
        return Stop.NONE if self.home_without and self.ends(age_s) else self.stop

    def then(self, age_s: float) -> str:
        """What is done, or comes next, in words."""
        stop = self.stop_at(age_s)
        if stop is not Stop.NONE:
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
        told_s=2.0,
        stop=Stop.HOLD,
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
        told_s=FLIGHT_MODE_S,
        stop=Stop.SILENT,
        stop_s=FLIGHT_MODE_S,
        home_s=None,
        instruction=CHECK_LINK,
        why="a pilot may have taken the vehicle",
    ),
    InputLimit(
        "heartbeat",
        "HEARTBEAT",
        "armed_s",
        told_s=5.0,
        home_s=30.0,
        instruction=CHECK_STREAMS,
        why="disarming and failsafes are not visible; on the ground it counts as disarmed",
    ),
    InputLimit(
        "GPS status",
        "GPS_RAW_INT",
        "fix_s",
        told_s=5.0,
        stop=Stop.HOLD,
        stop_s=10.0,
        home_s=30.0,
        instruction=TAKE_OVER_BLIND,
        why="the fix may be lost; it comes home by the positions, which still arrive",
    ),
    InputLimit(
        "battery",
        "SYS_STATUS",
        "battery_s",
        told_s=5.0,
        home_s=30.0,
        instruction=WATCH_BATTERY,
        why="the reserve cannot be monitored",
    ),
    InputLimit(
        "plan item",
        "MISSION_CURRENT",
        "item_s",
        told_s=5.0,
        home_s=60.0,
        instruction=CHECK_STREAMS,
        why="MISSION_SET_CURRENT is not confirmed: after four, legs are flown by DO_REPOSITION",
    ),
    InputLimit(
        "landed state",
        "EXTENDED_SYS_STATE",
        "landed_s",
        told_s=5.0,
        home_s=60.0,
        instruction=CHECK_STREAMS,
        why="armed and 5 m above home it counts as in the air, disarmed as on the ground",
    ),
)
"""Every input that a flight rests on; the gravest first."""

INPUT_ALARMS: Final = frozenset({NO_FIX, *(f"{limit.words} not heard" for limit in LIMITS)})
"""What is alarmed of while it stops the vehicle."""

_ages = attrgetter(*(limit.age for limit in LIMITS))
_TOLD_S: Final = tuple(limit.told_s for limit in LIMITS)
"""From which age on an input is missing at all; the other limits are no lower."""


class InputNews(NamedTuple):
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
        news: What to announce.
    """

    stop: Stop
    why: str
    back: bool
    home_why: str | None
    news: tuple[InputNews, ...]


CALM: Final = InputStatus(Stop.NONE, "", back=False, home_why=None, news=())


@dataclass(slots=True, eq=False)
class InputWatch:
    """Looks at the ages in every telemetry, and at whether GPS has a fix.

    Attributes:
        stopped: What no leg begins without, and is missing or not back for long enough.
        silent: Nothing is commanded meanwhile: a pilot may have taken the vehicle.
    """

    stopped: dict[str, Stop] = field(default_factory=dict)
    silent: bool = False
    # by what is missing: announced, when
    _told: dict[str, tuple[bool, float]] = field(default_factory=dict)
    _good_since_s: float | None = None  # since when the fix is good again
    _no_fix_since_s: float = 0.0  # since when it has none, as announced
    _alarmed_of_fix: bool = False  # of this loss

    def look(self, telemetry: Telemetry) -> InputStatus:
        """Take the next telemetry in."""
        waits = not telemetry.fix or self.stopped or self._told
        if not waits and all(map(lt, _ages(telemetry.ages), _TOLD_S)):
            return CALM
        missing: dict[str, Stop] = {}
        news: list[InputNews] = []
        home_why = None
        if not telemetry.fix:
            missing[NO_FIX] = Stop.HOLD
            news += self._told_of_fix(telemetry.told_s)
        stopped = tuple(self.stopped)
        for limit in LIMITS:
            age_s = getattr(telemetry.ages, limit.age)
            words = f"{limit.words} not heard"
            if limit.ends(age_s):
                home_why = home_why or f"{words} for {age_s:.0f} s"
            stop = limit.stop_at(age_s)
            if stop is not Stop.NONE:
                missing[words] = stop
            elif age_s >= limit.told_s:
                self.stopped.pop(words, None)  # home is flown without it
            news += self._told_of(limit, age_s, telemetry.told_s)
        back = self._back(missing, telemetry.told_s) and bool(stopped)
        if back and home_why is None:
            fix = "GPS has its fix again" if NO_FIX in stopped else "all of it is heard again"
            news.append(InputNews(fix, "going on"))
        self.silent = Stop.SILENT in self.stopped.values()
        stop = Stop.SILENT if self.silent else Stop.HOLD if self.stopped else Stop.NONE
        why = next(iter(missing), next(iter(self.stopped), ""))
        return InputStatus(stop, why, back, home_why, tuple(news))

    def _back(self, missing: dict[str, Stop], now_s: float) -> bool:
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

    def _told_of(self, limit: InputLimit, age_s: float, now_s: float) -> list[InputNews]:
        """At once, when it stops the vehicle, and now and then; and when it comes again."""
        if age_s < limit.told_s:
            told = self._told.pop(limit.words, None)
            back = InputNews(f"{limit.words} heard again", "", about=f"{limit.words} not heard")
            return [back] if told else []
        stops = limit.stop_at(age_s) is not Stop.NONE
        before, told_s = self._told.get(limit.words, (False, -math.inf))
        again = limit.words in self._told
        # What stops the vehicle is an alarm, which is said again by itself.
        if stops <= before and (stops or now_s < told_s + INPUT_REPEATED_S):
            return []
        self._told[limit.words] = (stops or before, now_s)
        return [
            InputNews(
                f"{limit.words} not heard for {age_s:.0f} s",
                limit.then(age_s) if stops > before or not again else "",
                limit.instruction,
                alarms=stops,
                about=f"{limit.words} not heard",
                age_s=age_s,
            )
        ]

    def _told_of_fix(self, now_s: float) -> list[InputNews]:
        """That it is lost, at once; as an alarm where it does not come back soon."""
        if NO_FIX not in self.stopped:
            self._no_fix_since_s, self._alarmed_of_fix = now_s, False
            return [InputNews("GPS has lost its fix", Stop.HOLD.value, TAKE_OVER_BLIND)]
        age_s = now_s - self._no_fix_since_s
        if self._alarmed_of_fix or age_s < FIX_ALARM_S:
            return []
        self._alarmed_of_fix = True
        what = f"GPS has no fix for {age_s:.0f} s"
        instruction = TAKE_OVER_BLIND
        return [
            InputNews(what, Stop.HOLD.value, instruction, alarms=True, about=NO_FIX, age_s=age_s)
        ]
