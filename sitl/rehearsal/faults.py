"""What can go wrong in a rehearsed flight, and when: every fault a row, every flight a seed."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from sitl.px4sim.motion.disturbances import WindSettings
from sitl.rehearsal.courses import (
    BATTERY,
    ITEM,
    LANDED,
    MODE,
    ON_MODE,
    PHASES,
    POSITION,
    SATELLITES,
    WRONG_STREAMS,
    Course,
    Schedule,
    ScheduledFault,
    altered,
    blind_and_empty,
    brief,
    diverted,
    drift,
    hand_back,
    hand_back_low,
    height,
    lie,
    often,
    on_board,
    one,
    placed,
    pushed,
    ready_taken,
    restart_taken,
    restarted_on_another,
    span,
    spells,
    stream,
    taken_in_haste,
    two_stations,
    walls,
    zone_in_haste,
)
from sitl.rehearsal.stand_ins.link import StreamFault

_AT_ONCE: Final = frozenset({"ready", "armed"})
FLIGHT_S: Final = 260.0

_JUMPS: Final = spells(
    4, 150.0, lambda d: ("jump", d.uniform(0.0, 2 * math.pi)), ("jump back", None), (3.0, 15.0)
)
_BUSY: Final = spells(6, 160.0, lambda _: ("busy", True), ("busy", False), (1.0, 8.0))


class Kind(NamedTuple):
    """A row of the table of faults.

    Attributes:
        words: Its line in the report.
        flights: How many of it a whole rehearsal has; 0: only one with the real programs has any.
        course: What happens.
        phase: Where it begins, if that is not to be drawn.
        loss: Share of packets that are lost.
        late_s: By so much commands come late, from arming on.
        old_s: By so much what the vehicle says comes late, from arming on.
        draws: Zones are drawn into the mission file.
        alone: It is two things at once already, or nothing: it is not combined with another.
    """

    words: str
    flights: int
    course: Course = lambda _: []
    phase: str = ""
    loss: float = 0.0
    late_s: float = 0.0
    old_s: float = 0.0
    draws: bool = False
    alone: bool = False


class Fault(Enum):
    """One kind of thing that goes wrong."""

    NONE = Kind("nothing", 6, alone=True)
    GUSTS = Kind("wind to 10 m/s with gusts", 20)
    STORM = Kind("wind of 12 to 25 m/s with gusts", 12)
    PUSHED = Kind("a gust pushes it towards a zone or the fence", 12, pushed, "INIT", alone=True)
    JUMPS = Kind("position estimate jumps by up to 4 m, and back", 20, _JUMPS, "INIT")
    DRIFT = Kind("position estimate drifts by 0.3 m/s", 12, drift(0.3, 0.0))
    ALTITUDE_JUMPS = Kind("altitude estimate jumps by 3 to 8 m", 16, height)
    BAROMETER = Kind("altitude estimate drifts by 0.3 m/s", 12, drift(0.0, 0.3))
    LOSS_1 = Kind("1 % of all packets lost", 8, loss=0.01)
    LOSS_5 = Kind("5 % of all packets lost", 10, loss=0.05)
    LOSS_20 = Kind("20 % of all packets lost", 16, loss=0.2)
    BURSTS = Kind("bursts of loss: all packets for 0.5 to 5 s, again and again", 16)
    LATE = Kind("commands arrive up to 4 s late", 12, late_s=4.0)
    OLD = Kind("what the vehicle says comes up to 2 s late", 12, old_s=2.0)
    SILENCE = Kind(
        "vehicle silent for 0.5 to 60 s",
        20,
        span("silent", on=True, off=False, seconds=lambda d: d.choice((0.5, 2, 5, 20, 60))),
    )
    BRIEF_STREAM = Kind("one stream lost, frozen, late or wrong for 3 s", 30, brief)
    LOST_POSITION = Kind("position lost, frozen, late or wrong", 24, stream(*POSITION))
    BLIND_AND_EMPTY = Kind(
        "position lost while the battery falls to its reserve", 6, blind_and_empty, alone=True
    )
    LOST_BATTERY = Kind("battery lost, frozen, late or wrong", 24, stream(*BATTERY))
    LOST_FIX = Kind("satellites lost, frozen, late or wrong", 24, stream(*SATELLITES))
    LOST_LANDED = Kind("landed state lost, frozen, late or wrong", 24, stream(*LANDED))
    LOST_ITEM = Kind("current item lost, frozen, late or wrong", 24, stream(*ITEM))
    LOST_MODE = Kind("mode lost, frozen, late or wrong", 24, stream(*MODE))
    NO_FIX = Kind(
        "GPS without a fix for 2 to 20 s",
        12,
        span("satellites", on=0, off=12, seconds=lambda d: d.uniform(2.0, 20.0)),
    )
    UPLOAD = Kind(
        "uploads rejected", 6, one("reject", lambda d: d.randrange(2)), "ready", alone=True
    )
    ALTERED = Kind("an item is stored that was not sent", 6, altered, "ready", alone=True)
    READY_TAKEN = Kind("pilot arms or chooses before us", 9, ready_taken, "ready", alone=True)
    BUSY = Kind("jumps dropped while a station downloads the plan", 8, _BUSY, "INIT")
    PILOT = Kind("pilot takes over", 48, one("pilot", lambda d: d.choice(ON_MODE)))
    STICKS = Kind("pilot moves the sticks", 16, one("sticks", lambda _: True))
    STICKS_ONLY = Kind(
        "pilot moves the sticks without COM_RC_OVERRIDE", 8, one("sticks", lambda _: False)
    )
    HAND_BACK = Kind("pilot takes over and hands back", 20, hand_back)
    HANDED_BACK_LOW = Kind(
        "pilot lands it, stops that low, and hands back", 8, hand_back_low, alone=True
    )
    TAKEN_IN_HASTE = Kind(
        "pilot takes over while commands of ours wait", 16, taken_in_haste, alone=True
    )
    PAUSE = Kind(
        "pilot pauses or diverts it in our own mode",
        12,
        often("pause", 60, (1.0, 3.0), lambda d: d.randrange(8) == 0),
    )
    DIVERTED = Kind(
        "diverted, or flown by the sticks, while we have it hold", 8, diverted, alone=True
    )
    TWO_STATIONS = Kind("two stations command at once", 16, two_stations)
    DISARMED = Kind(
        "disarmed by a station right after the arming",
        8,
        lambda d: [ScheduledFault(d.choice((0.0, 0.2, 1.0)), "disarm", False)],
        "armed",
    )
    KILLED_IN_AIR = Kind("disarmed by force in the air", 12, one("disarm", lambda _: True))
    HOME_MOVED = Kind(
        "home moved by a station: 25 m down, or 30 m sideways and 15 m up",
        20,
        one("home", lambda d: d.choice(((0.0, -25.0), (30.0, 15.0)))),
    )
    SPEED = Kind(
        "another speed by a station", 6, one("speed", lambda d: d.choice((2.0, 8.0, 12.0)))
    )
    PLAN_REPLACED = Kind("another mission put on board", 14, on_board("plan", lambda _: "other"))
    RESTARTED_ON_ANOTHER = Kind(
        *("another mission put on board while no companion runs", 8, restarted_on_another, "INIT"),
        alone=True,
    )
    SAME_PLAN = Kind("the same plan put on board again", 14, on_board("plan", lambda _: "same"))
    PLAN_DELETED = Kind("mission deleted by a station", 8, on_board("plan", lambda _: "none"))
    FENCE_DELETED = Kind(
        "fence deleted by a station", 10, on_board("fence", lambda _: None, back=1.0)
    )
    ZONE = Kind(
        "a zone is added on board in flight",
        14,
        on_board("fence", lambda d: d.uniform(10, 40), back=1.0),
    )
    REBOOT = Kind(
        "autopilot's link and clock start anew", 10, one("reboot", lambda d: d.uniform(1, 6))
    )
    STOPPED = Kind(
        "companion stalled for 0.5 to 60 s",
        20,
        one("stall", lambda d: d.choice((0.5, 2.0, 5.0, 15.0, 60.0))),
    )
    RESTART = Kind(
        "companion killed and restarted",
        20,
        lambda d: [ScheduledFault(0.0, "kill"), ScheduledFault(d.uniform(2.0, 40.0), "restart")],
    )
    RESTART_TAKEN = Kind(
        "pilot takes over while the companion is down", 16, restart_taken, alone=True
    )
    KILL = Kind("companion killed for good", 12, one("kill"))
    BATTERY = Kind("battery falls fast", 16, one("battery", lambda d: d.uniform(60.0, 400.0)))
    BATTERY_LIES = Kind("battery falls fast and says otherwise", 12, lie)
    VANISH = Kind("robots vanish", 10, one("vanish"))
    ONE_DEAD = Kind(
        "another UAV seeks the same robots, and dies",
        8,
        one("other uav", lambda d: d.uniform(5, 60)),
        "climb",
    )
    MAD_ROBOTS = Kind(
        "robots tell nonsense: future, NaN, jumps, zones",
        20,
        one("mad", lambda d: d.choice(("future", "nan", "jump", "zone", "far", "stamp"))),
        "climb",
    )
    RELOAD = Kind(
        "no-fly zones added by reload in flight",
        16,
        lambda d: [
            ScheduledFault(40.0 * again, "reload", d.uniform(-5.0, 40.0))
            for again in range(d.randrange(1, 4))
        ],
        draws=True,
    )
    WALL = Kind("walled in by reload in flight", 12, walls, draws=True)
    ZONE_ACROSS = Kind(
        "a zone is drawn across the leg under way",
        12,
        often("zone across", 3, (25.0, 50.0), lambda d: d.uniform(0.0, 6.0)),
        draws=True,
        alone=True,
    )
    ZONE_IN_HASTE = Kind(
        *("a zone is drawn over a way that waits", 12, zone_in_haste, "SEARCH"),
        draws=True,
        alone=True,
    )
    CORNERS = Kind(
        "sent around a corner that it does not stop at",
        12,
        often("corner", 4, (20.0, 35.0), lambda d: d.choice((None, 0.0, 0.6, 0.7))),
        "INIT",
        alone=True,
    )
    REQUESTS = Kind(
        "requests at random moments",
        16,
        often("request", 25, (1.0, 12.0), lambda d: d.random()),
        "climb",
    )
    TWO = Kind("two of these at once", 40, alone=True)
    MOVED_LINK = Kind("the vehicle is heard from another port", 0, alone=True)
    HOSTILE = Kind("strangers send noise, and messages of other vehicles", 0, alone=True)
    TWO_VEHICLES = Kind("a second vehicle speaks on the same radio", 0, alone=True)

    def __reduce_ex__(self, _: object) -> tuple[object, ...]:
        """By its name: courses do not go from process to process."""
        return getattr, (Fault, self.name)

    @property
    def words(self) -> str:
        """Its line in the report."""
        return self.value.words


_SINGLE: Final = tuple(fault for fault in Fault if not fault.value.alone)
"""What two of may happen in one flight."""


@dataclass(frozen=True, slots=True)
class Scene:
    """One flight to be rehearsed; everything in it follows from fault and seed."""

    fault: Fault
    seed: int

    @property
    def faults(self) -> frozenset[Fault]:
        """What goes wrong in it."""
        if self.fault is not Fault.TWO:
            return frozenset({self.fault})
        return frozenset(self.chance("two").sample(_SINGLE, 2))

    @property
    def judged(self) -> frozenset[str]:
        """The names that it is judged by: a moment of a wrong stream may end as a long one."""
        wrong = {
            WRONG_STREAMS[happening.value[0]]
            for happening in self.schedule()
            if happening.what == "stream" and happening.value[1] is StreamFault.WRONG
        }
        return frozenset({fault.name for fault in self.faults} | wrong)

    def most(self, what: str) -> float:
        """The most that its faults have of `loss`, `late_s` or `old_s`."""
        return max(float(getattr(fault.value, what)) for fault in self.faults)

    def schedule(self) -> Schedule:
        """What happens when."""
        happen: Schedule = []
        for fault in sorted(self.faults, key=lambda fault: fault.name):
            dice = self.chance(f"when {fault.name}")
            phase, later_s = self._begin(fault, dice)
            happen += placed(fault.value.course(dice), phase, later_s)
        return happen

    def _begin(self, fault: Fault, dice: random.Random) -> tuple[str, float]:
        """Its phase, by turns so that each gets its share, and how long after its beginning."""
        if fault.value.phase:
            at_once = fault.value.phase in _AT_ONCE
            return fault.value.phase, 0.0 if at_once else dice.uniform(0.0, 10.0)
        turn = self.seed % (len(PHASES) * 3 // 2)
        if turn >= len(PHASES):
            return "armed", dice.uniform(0.0, FLIGHT_S)
        return PHASES[turn], dice.choice((0.0, dice.uniform(0.0, 8.0)))

    def chance(self, what: str) -> random.Random:
        """Dice of their own for everything that is drawn."""
        return random.Random(f"{self.fault.name} {self.seed} {what}")  # noqa: S311 - rehearsal

    def __str__(self) -> str:
        both = f" ({', '.join(sorted(f.name for f in self.faults))})"
        return f"{self.fault.name}-{self.seed}{both if self.fault is Fault.TWO else ''}"


def wind_of(scene: Scene) -> WindSettings:
    """The wind that blows in it."""
    dice = scene.chance("wind")
    if Fault.STORM in scene.faults:
        return WindSettings(dice.uniform(12.0, 25.0), dice.uniform(0.0, 360.0), 3.0)
    if Fault.GUSTS not in scene.faults:
        return WindSettings()
    mean_m_s = dice.uniform(3.0, 7.0)
    return WindSettings(mean_m_s, dice.uniform(0.0, 360.0), (10.0 - mean_m_s) / 2.0)


def scenes(share: float = 1.0, seed: int | None = None) -> list[Scene]:
    """The flights of a rehearsal.

    Args:
        share: Of each fault's, but at least one.
        seed: Only this one of each, whether a whole rehearsal has it or not.
    """
    return [
        Scene(fault, number)
        for fault in Fault
        if fault.value.flights
        for number in (
            range(max(1, round(fault.value.flights * share))) if seed is None else (seed,)
        )
    ]
