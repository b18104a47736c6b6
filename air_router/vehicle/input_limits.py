"""The responses to a missing input while others are received, as one table.

Pure: ages are part of the telemetry.
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
    """The response while an input has been missing for too long."""

    NONE = "the mission goes on"
    HOLD = "holding"
    SILENT = "nothing is commanded"


@dataclass(frozen=True, slots=True)
class InputLimit:
    """One row of the table; times in seconds on the vehicle's clock.

    Attributes:
        words: The input's name, for pilots.
        message: The MAVLink messages that carry it.
        age: Its field in `Ages`.
        announce_s: Age at which it is announced.
        stop_s: Age at which no further leg starts and the response is `stop`; None: never.
        home_s: Age at which the mission ends; None: never.
        home_without: The vehicle comes home even if it is still missing.
        instruction: Action of the pilot or the operator.
        why: The reason for this response.
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
        """Whether the mission ends at this age."""
        return self.home_s is not None and age_s >= self.home_s

    def stop_at(self, age_s: float) -> InputResponse:
        """The response at this age."""
        if self.stop_s is None or age_s < self.stop_s:
            return InputResponse.NONE
        return InputResponse.NONE if self.home_without and self.ends(age_s) else self.stop

    def then(self, age_s: float) -> str:
        """The current or next response, as text."""
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
        why="legs are checked from the vehicle's position: it comes home once that is known again",
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
        why="a pilot may have taken over",
    ),
    InputLimit(
        "heartbeat",
        "HEARTBEAT",
        "armed_s",
        announce_s=5.0,
        home_s=30.0,
        instruction=CHECK_STREAMS,
        why="disarming or a failsafe may go unnoticed; a landed vehicle counts as disarmed",
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
        why="the fix may be lost; positions are still received, so the vehicle comes home by them",
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
        why="a jump cannot be confirmed: after four, legs are flown by DO_REPOSITION",
    ),
    InputLimit(
        "landed state",
        "EXTENDED_SYS_STATE",
        "landed_s",
        announce_s=5.0,
        home_s=60.0,
        instruction=CHECK_STREAMS,
        why="armed and 5 m above home counts as in the air, disarmed as on the ground",
    ),
)
"""Every input that a flight depends on; the most severe first."""

INPUT_ALARMS: Final = frozenset({NO_FIX, *(f"{limit.words} not received" for limit in LIMITS)})
"""Subjects of the alarms while an input stops the vehicle."""

_ages = attrgetter(*(limit.age for limit in LIMITS))
_ANNOUNCE_S: Final = tuple(limit.announce_s for limit in LIMITS)
"""The age from which an input is missing; the other limits are no lower."""


class InputAnnouncement(NamedTuple):
    """What to announce.

    Attributes:
        what: The input that is missing or received again.
        then: The response; empty: none.
        instruction: Action of the pilot or the operator; None: it is received again.
        alarms: The pilot has to act now: the vehicle waits for the input.
        about: Subject of the alarm, as in `InputWatch.stopped`.
        age_s: How long it has been missing.
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
        stop: The response meanwhile, with `why`.
        back: Legs may start again from now on.
        home_why: Why the mission ends for a missing input; None: it does not.
        announcements: Announcements that are due.
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
    """Checks the ages and the GPS fix in every telemetry update.

    Attributes:
        stopped: Inputs that are missing, or not yet back for long enough, and stop legs.
        silent: Nothing is commanded meanwhile: a pilot may have taken over.
    """

    stopped: dict[str, InputResponse] = field(default_factory=dict)
    silent: bool = False
    # by input: whether it stops the vehicle, time announced
    _announced: dict[str, tuple[bool, float]] = field(default_factory=dict)
    _good_since_s: float | None = None  # the fix is good again since
    _no_fix_since_s: float = 0.0  # without a fix since, as announced
    _alarmed_of_fix: bool = False  # alarm raised for this loss

    def update(self, telemetry: Telemetry) -> InputStatus:
        """Check the next telemetry."""
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
            words = f"{limit.words} not received"
            if limit.ends(age_s):
                home_why = home_why or f"{words} for {age_s:.0f} s"
            stop = limit.stop_at(age_s)
            if stop is not InputResponse.NONE:
                missing[words] = stop
            elif age_s >= limit.announce_s:
                self.stopped.pop(words, None)  # the vehicle comes home without it
            announcements += self._announce_missing(limit, age_s, telemetry.received_s)
        back = self._back(missing, telemetry.received_s) and bool(stopped)
        if back and home_why is None:
            fix = "GPS has its fix again" if NO_FIX in stopped else "all inputs are received again"
            announcements.append(InputAnnouncement(fix, "continuing"))
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
        """Whether all inputs have been received again for some time."""
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
        """Announce a missing input at once, when it stops the vehicle, and at intervals."""
        if age_s < limit.announce_s:
            announced = self._announced.pop(limit.words, None)
            back = InputAnnouncement(
                f"{limit.words} received again", "", about=f"{limit.words} not received"
            )
            return [back] if announced else []
        stops = limit.stop_at(age_s) is not InputResponse.NONE
        before, announced_s = self._announced.get(limit.words, (False, -math.inf))
        again = limit.words in self._announced
        # An input that stops the vehicle raises an alarm, which repeats on its own.
        if stops <= before and (stops or now_s < announced_s + INPUT_REPEATED_S):
            return []
        self._announced[limit.words] = (stops or before, now_s)
        return [
            InputAnnouncement(
                f"{limit.words} not received for {age_s:.0f} s",
                limit.then(age_s) if stops > before or not again else "",
                limit.instruction,
                alarms=stops,
                about=f"{limit.words} not received",
                age_s=age_s,
            )
        ]

    def _announce_fix(self, now_s: float) -> list[InputAnnouncement]:
        """Announce a lost fix at once, and raise an alarm if it does not return soon."""
        if NO_FIX not in self.stopped:
            self._no_fix_since_s, self._alarmed_of_fix = now_s, False
            return [
                InputAnnouncement("GPS has lost its fix", InputResponse.HOLD.value, TAKE_OVER_BLIND)
            ]
        age_s = now_s - self._no_fix_since_s
        if self._alarmed_of_fix or age_s < FIX_ALARM_S:
            return []
        self._alarmed_of_fix = True
        what = f"GPS has had no fix for {age_s:.0f} s"
        instruction = TAKE_OVER_BLIND
        return [
            InputAnnouncement(
                what, InputResponse.HOLD.value, instruction, alarms=True, about=NO_FIX, age_s=age_s
            )
        ]
