"""What can go wrong in a rehearsed flight, and when: every fault a row, every flight a seed."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from air_router.vehicle.px4 import FLOWN, NEWEST, Version
from sitl.px4sim.motion import WindSettings
from sitl.rehearsal import courses, documents, inspections, requests, takeovers
from sitl.rehearsal.courses import (
    BATTERY,
    ITEM,
    LANDED,
    MODE,
    PHASES,
    POSITION,
    SATELLITES,
    WRONG_STREAMS,
    Course,
    Schedule,
    choice,
    drift,
    often,
    on_board,
    one,
    placed,
    steps,
    stream,
    uniform,
)
from sitl.rehearsal.fakes import StreamFault

_AT_ONCE: Final = frozenset({"ready", "armed", "IDLE"})
_DRAWS: Final = ("reload", "wall", "enclose", "zone ", "move zone", "draw alone", "change")
"""And how the names of others begin."""

OLDER: Final = 0.375
"""Share of the flights with an older version of PX4 than the newest, of each as many."""

ROUTED: Final = 0.5
"""Share of the flights in which PX4's replies to other stations come over the companion's link: a
MAVLink router has them all on one."""

RESULT_FIRST: Final = 0.5
"""Share of the flights in which a transfer's result is handed over before its MISSION_ACK."""

_WIND: Final = {"WIND_COV": 2.0}
FLIGHT_S: Final = 260.0


class Kind(NamedTuple):
    """A row of the table of faults.

    Attributes:
        description: Its line in the report.
        flights: How many of it a whole rehearsal has; 0: only one with the real programs has any.
        course: What happens.
        turns: Or one of these, by turns: each seed the next.
        phase: Where it begins, if that is not to be drawn.
        loss: Share of packets that are lost.
        late_s: By so much commands come late, from arming on.
        old_s: By so much the vehicle's messages come late, from arming on.
        mission: Keys of the mission file that it flies with.
        waypoints: Of how many it has the first; 0: of all.
        records: Whether the companion keeps a record of the flight.
        document: Makes its mission file of the one in a hurry; None: zones get terms.
        terms: It makes it of one whose zones have got terms.
        streams: Messages that the companion receives beside the usual ones, and how often, Hz.
        parameters: Of the vehicle.
    """

    description: str
    flights: int
    course: Course = steps()
    phase: str = ""
    loss: float = 0.0
    late_s: float = 0.0
    old_s: float = 0.0
    mission: Mapping[str, Any] = MappingProxyType({})
    waypoints: int = 0
    records: bool = False
    document: documents.Draw | None = None
    terms: bool = False
    streams: Mapping[str, float] = MappingProxyType({})
    parameters: Mapping[str, float] = MappingProxyType({})
    turns: tuple[Course, ...] = ()


class Fault(Enum):
    """One kind of thing that goes wrong."""

    # The weather and the estimate.
    NONE = Kind("nothing", 6)
    GUSTS = Kind("wind to 10 m/s with gusts", 20)
    STORM = Kind("wind of 12 to 25 m/s with gusts", 12)
    PUSHED = Kind("a gust pushes it towards a zone or the fence", 12, courses.pushed, "INIT")
    JUMPS = Kind("position estimate jumps by up to 4 m, and back", 20, courses.jumps, "INIT")
    NEARED = Kind(
        *("position estimate jumps towards a zone or the fence", 8, courses.neared, "INIT")
    )
    DRIFT = Kind("position estimate drifts by 0.3 m/s", 12, drift(0.3, 0.0))
    ALTITUDE_JUMPS = Kind("altitude estimate jumps by 3 to 8 m", 16, courses.height)
    BAROMETER = Kind("altitude estimate drifts by 0.3 m/s", 12, drift(0.0, 0.3))
    # The link, and single streams of it.
    LOSS_1 = Kind("1 % of all packets lost", 8, loss=0.01)
    LOSS_5 = Kind("5 % of all packets lost", 10, loss=0.05)
    LOSS_20 = Kind("20 % of all packets lost", 16, loss=0.2)
    BURSTS = Kind("bursts of loss: all packets for 0.5 to 5 s, again and again", 16)
    LATE = Kind("commands arrive up to 4 s late", 12, late_s=4.0)
    OLD = Kind("the vehicle's messages come up to 2 s late", 12, old_s=2.0)
    SILENCE = Kind("vehicle silent for 0.5 to 55 s", 20, courses.silence)
    BRIEF_STREAM = Kind("one stream lost, frozen, late or wrong for 3 s", 30, courses.brief)
    LOST_POSITION = Kind("position lost, frozen, late or wrong", 24, stream(*POSITION))
    BLIND_AND_EMPTY = Kind(
        "position lost while the battery falls to its reserve", 6, courses.blind_and_empty
    )
    LOST_BATTERY = Kind("battery lost, frozen, late or wrong", 24, stream(*BATTERY))
    LOST_FIX = Kind("satellites lost, frozen, late or wrong", 24, stream(*SATELLITES))
    LOST_LANDED = Kind("landed state lost, frozen, late or wrong", 24, stream(*LANDED))
    LOST_ITEM = Kind("current item lost, frozen, late or wrong", 24, stream(*ITEM))
    LOST_MODE = Kind("mode lost, frozen, late or wrong", 24, stream(*MODE))
    NO_FIX = Kind("GPS without a fix for 2 to 20 s", 12, courses.no_fix)
    SATELLITES_GONE = Kind(
        "satellites lost for good, and PX4 sets home anew", 8, courses.satellites_gone
    )
    FOREIGN = Kind(
        *("a gimbal, another companion and another vehicle send on its link", 12),
        one("foreign", uniform(5.0, 40.0)),
    )
    POOR_FIX = Kind(
        "satellites good to 2 to 6 m only, for 6 to 60 s",
        12,
        one("accuracy", lambda d: (d.uniform(2.0, 6.0), d.choice((6.0, 20.0, 60.0)))),
    )
    # Getting ready.
    UPLOAD = Kind("uploads rejected", 6, one("reject", lambda d: d.randrange(2)), "ready")
    ALTERED = Kind("an item is stored that was not sent", 6, courses.altered, "ready")
    READY_TAKEN = Kind("pilot arms or chooses before us", 9, takeovers.ready_taken, "ready")
    BY_HAND = Kind("pilot takes off while a fence is refused", 4, takeovers.by_hand, "ready")
    MISPLACED = Kind(
        "pilot takes off, and begins the mission low and away", 8, takeovers.misplaced, "ready"
    )
    WRONG_VEHICLE = Kind(
        "the vehicle is a fixed wing, a rover or a VTOL", 6, takeovers.wrong_vehicle, "ready"
    )
    OTHER_AUTOPILOT = Kind(
        *("the autopilot of a multicopter is none with PX4", 4),
        *(takeovers.other_autopilot, "ready"),
    )
    TYPE_CHANGES = Kind(
        "the vehicle on the link reports another type",
        *(8, one("airframe", choice(*takeovers.NO_MULTICOPTERS))),
    )
    TWINS = Kind(
        "another autopilot with the same system id on the link", 8, one("twin", value=True)
    )
    BUSY = Kind("jumps dropped while a station downloads the plan", 8, courses.busy, "INIT")
    # The pilot and other stations.
    PILOT = Kind("pilot takes over", 48, one("pilot", choice(*takeovers.ON_MODE)))
    STICKS = Kind("pilot moves the sticks", 16, one("sticks", value=True))
    STICKS_ONLY = Kind(
        "pilot moves the sticks, which take nothing over", 8, one("sticks", value=False)
    )
    STICKS_LOST = Kind("the pilot's transmitter is lost: PX4 acts", 8, courses.sticks_lost)
    HAND_BACK = Kind("pilot takes over and hands back", 20, takeovers.hand_back)
    HANDED_BACK_LOW = Kind(
        "pilot lands it, stops that low, and hands back", 8, takeovers.hand_back_low
    )
    HANDED_BACK_HIGH = Kind(
        "pilot climbs with it into a zone, and hands back there and below",
        8,
        takeovers.hand_back_high,
    )
    ZONE_ABOVE = Kind(
        "a zone is drawn above its climb, given back low", 5, takeovers.zone_above, "SEARCH"
    )
    ZONE_AT = Kind(
        "a zone is drawn below, above, around or across it, whatever it does",
        *(len(takeovers.ZONES_AT), steps(), "SEARCH"),
        turns=takeovers.ZONES_AT,
    )
    TAKEN_IN_HASTE = Kind(
        "pilot takes over while commands of ours wait", 16, takeovers.taken_in_haste
    )
    HELD_IN_HASTE = Kind(
        "pilot takes over while commands of ours wait, and chooses the mode of before",
        *(2 * len(takeovers.HELD_IN_HASTE), steps(), "INIT"),
        turns=takeovers.HELD_IN_HASTE,
    )
    SILENCE_TAKEN = Kind("pilot takes over during a silence", 12, takeovers.silence_taken)
    CHOSEN_BACK = Kind(
        "pilot chooses the mode of before over an order of ours that has not shown",
        *(3 * len(takeovers.CHOSEN_BACK), steps(), "INIT"),
        turns=takeovers.CHOSEN_BACK,
    )
    STALL_TAKEN = Kind(
        *("pilot takes over while the companion stands still for 0.2 to 2 s", 40),
        takeovers.stalled_taken,
    )
    PAUSE = Kind("pilot pauses or diverts it in our own mode", 12, takeovers.paused)
    DIVERTED = Kind(
        "diverted, or flown by the sticks, while we have it hold", 8, takeovers.diverted
    )
    DIVERTED_CLOSE = Kind(
        "diverted towards a zone that it passes", 48, takeovers.diverted_close, "INIT"
    )
    DIVERTED_WAITING = Kind(
        "diverted while commands of ours wait", 8, takeovers.diverted_waiting, "INIT"
    )
    LEFT_BEHIND = Kind(
        "near a zone that it has left, without its plan", 8, takeovers.left_behind, "SEARCH"
    )
    DOUBTED = Kind("zones change, and the altitude is in doubt", 8, takeovers.doubted, "INIT")
    DOUBTED_AMONG = Kind(
        *("altitude in doubt among zones below and above", 8, takeovers.doubted_among, "INIT")
    )
    DOUBTED_WALLED = Kind(
        "altitude in doubt within walls that begin above it", 6, takeovers.doubted_walled, "INIT"
    )
    TWO_STATIONS = Kind("two stations command at once", 16, takeovers.two_stations)
    DISARMED = Kind("disarmed by a station right after the arming", 8, takeovers.disarmed, "armed")
    KILLED_IN_AIR = Kind("disarmed by force in the air", 12, one("disarm", value=True))
    HOME_MOVED = Kind(
        "home moved by a station: 25 m down, or 30 m sideways and 15 m up", 20, courses.home_moved
    )
    SPEED = Kind("another speed by a station", 6, one("speed", choice(2.0, 8.0, 12.0)))
    PLAN_REPLACED = Kind("another mission put on board", 14, on_board("plan", "other"))
    PLAN_IN_RENEWAL = Kind(
        "another mission put on board while ours is being renewed",
        *(8, takeovers.plan_in_renewal, "INIT"),
    )
    LIST_AMONG_OURS = Kind(
        "another station stores a list as soon as ours is there",
        *(2 * len(takeovers.LISTS_AMONG_OURS), steps(), "ready"),
        turns=takeovers.LISTS_AMONG_OURS,
    )
    RESTARTED_ON_ANOTHER = Kind(
        "another mission put on board while no companion runs", 8, takeovers.replaced_alone, "INIT"
    )
    PLAN_AT_START = Kind("mission put on board as it starts", 6, takeovers.plan_at_start, "armed")
    START_LOST = Kind(
        "the start is lost, and another mission put on board", 6, takeovers.start_lost, "armed"
    )
    SAME_PLAN = Kind("the same plan put on board again", 14, on_board("plan", "same"))
    PLAN_DELETED = Kind("mission deleted by a station", 8, on_board("plan", "none"))
    FENCE_DELETED = Kind("fence deleted by a station", 10, on_board("fence", None, back=1.0))
    ZONE = Kind(
        "a zone is added on board in flight", 14, on_board("fence", uniform(10, 40), back=1.0)
    )
    # The autopilot, the companion and the battery.
    REBOOT = Kind("autopilot's link and clock start anew", 10, one("reboot", uniform(1, 6)))
    STOPPED = Kind(
        "companion stalled for 0.5 to 60 s", 20, one("stall", choice(0.5, 2.0, 5.0, 15.0, 60.0))
    )
    RESTART = Kind("companion killed and restarted", 20, courses.restart)
    RESTART_TAKEN = Kind(
        "pilot takes over while the companion is down", 16, takeovers.restart_taken
    )
    KILL = Kind("companion killed for good", 12, one("kill"))
    BATTERY = Kind("battery falls fast", 16, one("battery", uniform(60.0, 400.0)))
    BATTERY_LIES = Kind("battery falls fast and reports otherwise", 12, courses.lie)
    BATTERY_DROPS = Kind("battery falls to its reserve at once", 6, one("glitch", (20, 1e9)))
    BATTERY_GLITCH = Kind("battery reports 0 % or far too little, briefly", 12, courses.glitches)
    # Robots.
    VANISH = Kind("robots vanish", 10, one("vanish"))
    ONE_DEAD = Kind(
        "another UAV seeks the same robots, and dies", 8, one("other uav", uniform(5, 60)), "climb"
    )
    MAD_ROBOTS = Kind(
        "robots send nonsense: future, NaN, jumps, zones", 20, courses.mad_robots, "climb"
    )
    JUMPING_POSES = Kind(
        "robots are hostile: their positions jump five times a second",
        *(4, one("mad", "sway"), "climb"),
    )
    WEAK_LINKS = Kind(
        *("links are slow, break, or are reported falsely; robots drive", 12),
        mission={"timers": {"init_s": 8, "explore_s": 6, "search_s": 10, "communicate_s": 10}},
    )
    GOALS = Kind(
        "robots send goals, some that the mission does not name",
        *(12, often("goals", 6, uniform(8.0, 25.0), lambda d: (d.random() < 0.5, d.random()))),
        "INIT",
        mission={"goals_from": ["callisto"]},
    )
    LAYERS = Kind(
        "pilot takes one of two UAVs above its layer, hands it back there, and then lower",
        12,
        steps(
            *((0.0, "pilot", "AUTO_LOITER"), (1.0, "climb", choice(3.0, 8.0, 9.0, 11.0))),
            *((10.0, "hand back"), (25.0, "climb", 0.0), (33.0, "hand back")),
        ),
    )
    # The operator.
    RELOAD = Kind("no-fly zones added by reload in flight", 16, courses.zones)
    REFUSED = Kind("a changed fence is refused, or stored otherwise", 10, courses.refused)
    WALL = Kind("walled in by reload in flight", 12, courses.walls)
    ZONE_ACROSS = Kind("a zone is drawn across the leg under way", 12, courses.zones_across)
    ZONE_IN_HASTE = Kind(
        "a zone is drawn over a way that waits", 12, courses.zone_in_haste, "SEARCH"
    )
    CORNERS = Kind("sent around a corner that it does not stop at", 12, requests.corners, "INIT")
    FAST_CORNERS = Kind(
        *("sent around such a corner at 8 m/s", 6, requests.corners, "INIT"),
        waypoints=7,
        mission={"speed_m_s": 8.0},
    )
    REQUESTS = Kind("requests at random moments", 16, requests.at_random, "climb")
    SENT = Kind("sent to several points, held, and on", 10, requests.sent, "INIT")
    EXPLORED = Kind(
        *("a short mission explored, by two companions", 10, requests.explored, "climb"),
        waypoints=9,
        records=True,
        mission={"duration_s": 190, "timers": {"init_s": 400, "search_s": 10}},
    )
    IDLE = Kind(
        *("nothing is left to explore", 6),
        waypoints=2,
        mission={
            "duration_s": 420,
            "timers": {"init_s": 400, "search_s": 10, "communicate_s": 10, "revisit_s": 120},
        },
    )
    NO_FIX_IDLE = Kind(
        *("GPS without a fix on its way to the middle of the robots", 5),
        *(courses.no_fix_on_a_leg, "IDLE"),
        waypoints=2,
        mission={
            "duration_s": 420,
            "speed_m_s": 1.5,
            "when_explored": "hover",
            "timers": {"init_s": 400, "search_s": 10, "communicate_s": 10, "revisit_s": 120},
        },
    )
    LANDED_HERE = Kind("requested to land where it holds", 6, requests.landed_here, "INIT")
    ZONE_BELOW = Kind("a zone is drawn below its landing", 6, requests.landed_on, "INIT")
    ALTITUDES = Kind(
        *("requested to hold at other altitudes", 6, requests.altitudes, "INIT"),
        mission={"altitudes_m": [30, 60]},
    )
    HOME_FOR_GOOD = Kind("requests on a way home for a fault", 10, requests.home_for_good, "INIT")
    LANDING_LOST = Kind(
        "no command arrives for 25 to 45 s on its way home, and as it is to land",
        *(8, steps((0.0, "deaf", True), (uniform(25.0, 45.0), "deaf", False)), "HOME"),
    )
    ENDURANCE = Kind(
        *("a way home that takes more than the reserve", 6, one("battery", 250.0), "ready"),
        mission={"endurance_s": 250, "battery_reserve": 0.1, "duration_s": 600},
    )
    # Classes that the judge was blind to: units, axes, old inputs, several UAVs ...
    MAP_FILES = Kind("zones of map files in feet", 8, document=documents.of_map_files)
    LOCAL_METRES = Kind(
        "a mission in metres of an origin of its own", 3, document=documents.in_local_metres
    )
    WINDY = Kind(
        *("wind from one side, which is reported", 4),
        document=documents.with_way_home,
        streams=_WIND,
        parameters={"EKF2_DRAG_CTRL": 1},
    )
    HANDED_BACK_MOVING = Kind(
        *("pilot flies it low, and it is given back on the way", 6),
        *(takeovers.hand_back_moving, "SEARCH"),
    )
    DAILY_HOURS = Kind(
        "zones with days and hours",
        *(8, one("vanish")),
        document=documents.with_daily_hours,
        waypoints=9,
        mission={"duration_s": 190, "timers": {"init_s": 400, "search_s": 10}},
    )
    ALTERED_LISTS = Kind(
        "fence or rally points are stored otherwise", 8, inspections.altered_lists, "ready"
    )
    FENCE_MOVED = Kind("a station moves the fence", 8, inspections.fence_moved)
    ZONE_MOVED = Kind("a zone is moved by reload", 6, inspections.zone_moved, "INIT")
    STALE = Kind("sent around corners while its position is old", 8, inspections.stale, "INIT")
    RESUMED_AMONG = Kind(
        "a zone is drawn while no companion runs", 8, inspections.resumed_among, "INIT"
    )
    RESUMED_BLIND = Kind(
        *("companion killed while it seeks, and resumed without a record", 8),
        *(inspections.without_record, "SEARCH"),
        waypoints=9,
        mission={
            "duration_s": 420,
            "timers": {"init_s": 25, "explore_s": 60, "search_s": 8, "communicate_s": 10},
        },
    )
    PAST_ALL = Kind(
        *("sent along every zone and fence", 4, inspections.past_all, "INIT"),
        mission={"duration_s": 400},
    )
    LANDED_AT = Kind(
        *("requested to land over low zones, at other altitudes", 6, inspections.landed_at, "INIT"),
        document=documents.over_low_zones,
        mission={"duration_s": 260},
    )
    SECOND_UAV = Kind(
        *("the second of two UAVs", 8, inspections.of_two, "INIT"),
        document=documents.of_second_uav,
    )
    LOW_AMONG_LAYERS = Kind(
        *("the second of two UAVs is handed back low", 6, takeovers.hand_back_low, "SEARCH"),
        document=documents.of_second_uav,
    )
    LAYERS_REDRAWN = Kind(
        *("zones change between the corridors of two UAVs", 6, inspections.of_two_redrawn, "INIT"),
        document=documents.of_second_uav,
    )
    FILE_CHANGED = Kind("more than zones is changed by reload", 8, inspections.file_changed, "INIT")
    FORGED = Kind(
        *("robots hand over poses of others", 6, inspections.forged, "INIT"),
        mission={
            "timers": {"init_s": 15, "explore_s": 8, "search_s": 12, "communicate_s": 5},
            "duration_s": 240,
        },
    )
    POSES_CARRIED = Kind(
        *("robots drive away, and others send their positions", 6, inspections.carried, "INIT"),
        mission={
            "timers": {"init_s": 10, "explore_s": 6, "search_s": 8, "communicate_s": 5},
            "duration_s": 260,
        },
    )
    ZONES_TAKEN = Kind(
        "zones are drawn while a pilot takes it, or has it",
        *(4 * len(takeovers.ZONES_TAKEN), steps(), "INIT"),
        turns=takeovers.ZONES_TAKEN,
    )
    ZONE_OVER_TAKEN = Kind(
        *("a zone is drawn over a vehicle that a pilot has", 6, takeovers.zone_over_taken, "INIT"),
        document=documents.as_it_is,
    )
    CLAIMS = Kind(
        "other systems and components send as the autopilot", 12, inspections.claims, "INIT"
    )
    ASKED_EVERYWHERE = Kind(
        *("every request is sent in every state", 24, inspections.requested_everywhere),
        mission={"timers": {"init_s": 30, "explore_s": 30, "search_s": 20, "communicate_s": 15}},
    )
    ASKED_IN_IDLE = Kind(
        *("every request is sent while nothing is left to do", 6, inspections.requested_in_idle),
        waypoints=2,
        mission={
            "duration_s": 420,
            "timers": {"init_s": 400, "search_s": 10, "communicate_s": 10, "revisit_s": 120},
        },
    )
    # Two at once, and what only the real programs fly.
    TWO = Kind("two of these at once", 40)
    MOVED_LINK = Kind("the vehicle's messages come from another port", 0)
    HOSTILE = Kind("strangers send noise, and messages of other vehicles", 0)
    TWO_VEHICLES = Kind("a second vehicle sends on the same radio", 0)

    def __reduce_ex__(self, _: object) -> tuple[object, ...]:
        """By its name: courses do not go from process to process."""
        return getattr, (Fault, self.name)


BY_HAND: Final = frozenset({Fault.BY_HAND, Fault.MISPLACED})
"""In these the pilot takes off."""

OF_SECOND: Final = frozenset({Fault.SECOND_UAV, Fault.LOW_AMONG_LAYERS})
"""In these the second of two UAVs is judged."""

WIDE: Final = frozenset({Fault.NONE, Fault.GUSTS, Fault.REQUESTS})
"""In these one zone is kept from by more than the others."""

_ALONE: Final = frozenset(
    {
        *(Fault.NONE, Fault.PUSHED, Fault.BLIND_AND_EMPTY, Fault.UPLOAD, Fault.ALTERED),
        *(Fault.READY_TAKEN, Fault.HANDED_BACK_LOW, Fault.TAKEN_IN_HASTE, Fault.DIVERTED),
        *(Fault.HANDED_BACK_HIGH, Fault.REFUSED, Fault.BY_HAND, Fault.WEAK_LINKS, Fault.GOALS),
        *(Fault.PLAN_AT_START, Fault.RESTARTED_ON_ANOTHER, Fault.RESTART_TAKEN, Fault.ZONE_ACROSS),
        *(Fault.ZONE_IN_HASTE, Fault.CORNERS, Fault.TWO, Fault.SENT, Fault.EXPLORED),
        *(Fault.IDLE, Fault.LANDED_HERE, Fault.ALTITUDES, Fault.HOME_FOR_GOOD, Fault.ENDURANCE),
        *(Fault.SILENCE_TAKEN, Fault.MISPLACED, Fault.ZONE_ABOVE, Fault.ZONE_BELOW),
        *(Fault.STALL_TAKEN, Fault.CHOSEN_BACK, Fault.HELD_IN_HASTE, Fault.START_LOST),
        *(Fault.FAST_CORNERS, Fault.NEARED),
        *(Fault.DIVERTED_CLOSE, Fault.DOUBTED, Fault.DOUBTED_AMONG, Fault.DOUBTED_WALLED),
        *(Fault.LEFT_BEHIND, Fault.LAYERS, Fault.MOVED_LINK),
        Fault.DIVERTED_WAITING,
        *(Fault.HOSTILE, Fault.TWO_VEHICLES, Fault.WRONG_VEHICLE, Fault.TYPE_CHANGES),
        *(Fault.JUMPING_POSES, Fault.POOR_FIX, Fault.SATELLITES_GONE, Fault.STICKS_LOST),
        *(Fault.MAP_FILES, Fault.LOCAL_METRES, Fault.WINDY, Fault.DAILY_HOURS),
        *(Fault.ALTERED_LISTS, Fault.FENCE_MOVED, Fault.ZONE_MOVED, Fault.STALE, Fault.PAST_ALL),
        *(Fault.RESUMED_AMONG, Fault.LANDED_AT, Fault.SECOND_UAV, Fault.FILE_CHANGED),
        *(Fault.FORGED, Fault.CLAIMS, Fault.ASKED_EVERYWHERE, Fault.HANDED_BACK_MOVING),
        *(Fault.ASKED_IN_IDLE, Fault.RESUMED_BLIND, Fault.NO_FIX_IDLE),
        *(Fault.ZONE_AT, Fault.PLAN_IN_RENEWAL, Fault.LIST_AMONG_OURS),
        *(Fault.POSES_CARRIED, Fault.ZONES_TAKEN, Fault.ZONE_OVER_TAKEN),
        *(Fault.LOW_AMONG_LAYERS, Fault.LAYERS_REDRAWN, Fault.LANDING_LOST, Fault.OTHER_AUTOPILOT),
    }
)
"""Two things at once already, or nothing: not combined with others."""

_SINGLE: Final = tuple(fault for fault in Fault if fault not in _ALONE)
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

    @property
    def draws(self) -> bool:
        """Whether zones are drawn into the mission file."""
        return any(happening.what.startswith(_DRAWS) for happening in self.schedule())

    @property
    def result_first(self) -> bool:
        """Whether MAVSDK hands over a transfer's result before its MISSION_ACK.

        Where courses come by turns every second scene has it, so that with an odd number of them
        each comes with both.
        """
        if self.fault.value.turns:
            return self.seed % 2 == 1
        return self.chance("MAVSDK").random() < RESULT_FIRST

    @property
    def routed(self) -> bool:
        """Whether the companion's link carries PX4's replies to other stations, too."""
        return self.chance("router").random() < ROUTED

    @property
    def px4(self) -> Version:
        """The version of PX4 that it is flown with."""
        rng = self.chance("PX4")
        return rng.choice(FLOWN[:-1]) if rng.random() < OLDER else NEWEST

    def most(self, what: str) -> float:
        """The most that its faults have of `loss`, `late_s` or `old_s`."""
        return max(float(getattr(fault.value, what)) for fault in self.faults)

    def schedule(self) -> Schedule:
        """What happens when."""
        happen: Schedule = []
        for fault in sorted(self.faults, key=lambda fault: fault.name):
            rng = self.chance(f"when {fault.name}")
            phase, later_s = self._begin(fault, rng)
            turns = fault.value.turns
            course = turns[self.seed % len(turns)] if turns else fault.value.course
            happen += placed(course(rng), phase, later_s)
        return happen

    def _begin(self, fault: Fault, rng: random.Random) -> tuple[str, float]:
        """Its phase, by turns so that each gets its share, and how long after its beginning."""
        if fault.value.phase:
            at_once = fault.value.phase in _AT_ONCE
            return fault.value.phase, 0.0 if at_once else rng.uniform(0.0, 10.0)
        turn = self.seed % (len(PHASES) * 3 // 2)
        if turn >= len(PHASES):
            return "armed", rng.uniform(0.0, FLIGHT_S)
        return PHASES[turn], rng.choice((0.0, rng.uniform(0.0, 8.0)))

    def chance(self, what: str) -> random.Random:
        """A random generator of its own for everything that is drawn."""
        return random.Random(f"{self.fault.name} {self.seed} {what}")  # noqa: S311 - rehearsal

    def __str__(self) -> str:
        both = f" ({', '.join(sorted(f.name for f in self.faults))})"
        return f"{self.fault.name}-{self.seed}{both if self.fault is Fault.TWO else ''}"


def wind_of(scene: Scene) -> WindSettings:
    """The wind that blows in it."""
    rng = scene.chance("wind")
    if Fault.STORM in scene.faults:
        return WindSettings(rng.uniform(12.0, 25.0), rng.uniform(0.0, 360.0), 3.0)
    if scene.fault is Fault.WINDY:
        side_deg = 90.0 * scene.seed + rng.uniform(-8.0, 8.0)
        return WindSettings(rng.uniform(5.0, 7.0), side_deg % 360.0, 0.3)
    if Fault.GUSTS not in scene.faults:
        return WindSettings()
    mean_m_s = rng.uniform(3.0, 7.0)
    return WindSettings(mean_m_s, rng.uniform(0.0, 360.0), (10.0 - mean_m_s) / 2.0)


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
