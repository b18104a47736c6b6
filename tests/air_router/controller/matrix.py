"""Every state, with every interlock raised, and every event: what the controller does then.

Each cell is the real controller in a pretended flight: it is brought into the state by flying, the
interlock is raised by what a vehicle would report, and the event is given once that stands.
"""

from dataclasses import dataclass

from air_router.controller.model import requests
from air_router.controller.model.actions import (
    Announce,
    CommandAck,
    FlyToNode,
    FlyToPoint,
    HoldHere,
    LandHere,
    StateChanged,
)
from air_router.controller.model.events import AirspaceChanged, RobotPose
from air_router.controller.model.states import State
from air_router.controller.motion.interlocks import INTERLOCKS
from air_router.vehicle.px4.limits import LINK_SILENT_S
from air_router.vehicle.vehicle import (
    FlightMode,
    LinkSilent,
    PlanCompared,
    PlanReplaced,
    Severity,
)
from geo.airspace.zone import Circle, Zone
from geo.frame import Point
from tests.air_router.conftest import CORNERS, PretendFlight

STEP_S = 0.5
RAISED_S = 5.0  # until then an interlock stands that stands at all
AFTER_S = 20.0  # so long is looked what follows an event
ELSEWHERE = Point(-60.0, 25.0)  # clear, and not on the way
MOTIONS = (FlyToNode, FlyToPoint, HoldHere, LandHere)


class Flight(PretendFlight):
    """One whose take-off goes on by itself, as PX4's does."""

    def move(self):
        super().move()
        top_m = self.mission.altitude_above_home_m
        if self.in_air and self.mode is FlightMode.MISSION and self.altitude_m < top_m:
            self.altitude_m = min(self.altitude_m + 0.5 * self.step_s, top_m)


# The states, flown to.


def _away(make):
    flight = make()
    flight.take_off()
    flight.fly_away()
    return flight


def _ready(make):
    flight = make()
    flight.take_off_halfway()
    return flight


def _seeking(make):
    flight = make()
    flight.take_off()
    flight.fly_to_state(State.SEARCH)
    flight.fly_for(2.0)
    return flight


def _requested(request, before=_away):
    def fly(make):
        flight = before(make)
        assert flight.operator_requests(request).accepted
        flight.fly_for(2.0)
        return flight

    return fly


def _talking(make):
    flight = make()
    flight.robots = dict(CORNERS)
    flight.take_off()
    flight.fly_to_state(State.COMM)
    flight.robots = {}  # it stays there
    return flight


def _idle(make):
    flight = make(one_waypoint=True, radius_m=1000.0)
    flight.robots = dict(CORNERS)
    flight.take_off()
    flight.fly_to_state(State.IDLE)
    flight.robots = {}
    flight.fly_for(5.0)  # it hovers
    return flight


def _landing(make):
    flight = _requested(requests.ComeHome())(make)
    flight.fly_to_state(State.LAND)
    flight.fly_for(2.0)
    return flight


def _passive(make):
    flight = _away(make)
    flight.pilot_chooses(FlightMode.POSITION)
    flight.fly_for(1.0)
    return flight


def _done(make):
    flight = _landing(make)
    flight.lands()
    return flight


STATES = {
    State.READY: _ready,
    State.INIT: _away,
    State.SEARCH: _seeking,
    State.COMM: _talking,
    State.IDLE: _idle,
    State.EXPL: _requested(requests.ExploreNow(), _seeking),
    State.GOTO: _requested(requests.GoTo(points=(ELSEWHERE,), hold_s=600.0)),
    State.HOLD: _requested(requests.HoldNow()),
    State.HOME: _requested(requests.ComeHome()),
    State.LAND: _landing,
    State.PASSIVE: _passive,
    State.DONE: _done,
}
"""Each takes what makes a flight on the ground, and returns it in that state."""


# The interlocks, raised by what a vehicle reports.


def _pass(flight, seconds, silent_s=None):
    """Time passes; with `silent_s` nothing is received meanwhile."""
    for _ in range(round(seconds / STEP_S)):
        if silent_s is None:
            flight.step()
        else:
            silent_s += STEP_S
            flight.now_s += STEP_S
            flight.give(LinkSilent(flight.now_s, silent_s))
    return silent_s


def _nothing(flight):
    """It flies on."""


def _no_fix(flight):
    flight.fix = False


def _high(flight):
    flight.shown = {"altitude_m": flight.altitude_m + 25.0}


def _inaccurate(flight):
    flight.shown = {"accuracy_m": 9.0}


def _other_order(flight):
    there = Point(flight.position.east_m - 40.0, flight.position.north_m + 40.0)
    flight.shown = {"target": there, "item": 99}


def _other_plan(flight):
    flight.deaf = True  # it does not follow the hold
    flight.give(PlanReplaced(flight.now_s))
    flight.give(PlanCompared(flight.now_s, "other waypoints"))


def _plan_replaced(flight):
    flight.give(PlanReplaced(flight.now_s))


def _zones(flight):
    far = Zone("far", Circle(Point(-95.0, 60.0), 3.0))
    flight.give(AirspaceChanged(flight.mission.fences, (*flight.mission.zones, far)))


RAISES = {
    "none": _nothing,
    "LINK_SILENT": _nothing,
    "INPUT_MISSING": _no_fix,
    "ALTITUDE_JUMP": _high,
    "CONDITIONS": _inaccurate,
    "FOREIGN_ORDER": _other_order,
    "RELEASING": _other_plan,
    "PLAN_CHECK": _plan_replaced,
    "ZONE_UPDATE": _zones,
}


# The events.


def _request(request):
    return lambda flight: flight.give(request)


def _battery(flight):
    flight.battery = flight.mission.battery_reserve - 0.01


def _pilot(flight):
    flight.mode, flight.target = FlightMode.POSITION, None


def _failsafe(flight):
    flight.mode, flight.target, flight.failsafe = FlightMode.RETURN, None, True


def _robot(flight):
    name = flight.controller.status().robot or "io"
    flight.give(RobotPose(name, CORNERS[name], flight.now_s, name))


def _zone_on_the_way(flight):
    east_m, north_m = flight.position
    ahead = Zone("ahead", Circle(Point(east_m + 15.0, north_m), 4.0))
    flight.give(AirspaceChanged(flight.mission.fences, (*flight.mission.zones, ahead)))


EVENTS = {
    "nothing": _nothing,
    "hold": _request(requests.HoldNow()),
    "resume": _request(requests.GoOn()),
    "home": _request(requests.ComeHome()),
    "land": _request(requests.LandNow()),
    "goto": _request(requests.GoTo(points=(ELSEWHERE,))),
    "seek": _request(requests.SeekNow(robot="io")),
    "explore": _request(requests.ExploreNow()),
    "altitude": _request(requests.ChangeAltitude(altitude_m=40.0)),
    "reserve": _battery,
    "pilot": _pilot,
    "failsafe": _failsafe,
    "robot": _robot,
    "zones": _zone_on_the_way,
    "plan": _plan_replaced,
    "silence": lambda flight: flight.give(LinkSilent(flight.now_s, LINK_SILENT_S + 1.0)),
}
REQUESTS = ("hold", "resume", "home", "land", "goto", "seek", "explore", "altitude")


@dataclass(frozen=True)
class Cell:
    """What was decided in one cell.

    Attributes:
        state: Selected; `interlock` and `event` alike.
        stood: The interlock stood when the event was given.
        then: The state at the end.
        ours: The vehicle was ours when the event was given; `ours_at_end` at the end.
        held_back: Commanded since the interlock was raised, before the event.
        motions: Commanded after the event, in order.
        answer: To the request; None: the event is none.
        announced: The severities and texts announced after the event.
        waiting: What kept the mission waiting at the end.
    """

    state: State
    interlock: str
    event: str
    stood: bool
    then: State
    ours: bool
    ours_at_end: bool
    held_back: tuple[type, ...]
    motions: tuple[type, ...]
    answer: CommandAck | None
    announced: tuple[tuple[Severity, str], ...]
    waiting: str | None


def raise_interlock(flight, name):
    """Raise it, and let it stand.

    Returns for how long nothing was received, None where it is, and how many actions there were
    before it stood.
    """
    before = len(flight.actions)
    RAISES[name](flight)
    if name == "LINK_SILENT":
        return _pass(flight, LINK_SILENT_S + 1.0, silent_s=0.0), before
    for _ in range(round(RAISED_S / STEP_S)):
        if stands(flight, name):
            break
        before = len(flight.actions)
        flight.step()
    return None, before


def stands(flight, name):
    """Whether an interlock stands now."""
    context = flight.controller.context
    return name == "none" or any(row.name == name and row.raised(context) for row in INTERLOCKS)


def cell(flight, state, interlock, event, after_s=AFTER_S):
    """Fly one cell; the flight is in the state already."""
    silent_s, raised = raise_interlock(flight, interlock)
    stood, ours = stands(flight, interlock), flight.controller.in_charge
    since = len(flight.actions)
    EVENTS[event](flight)
    if event == "silence" and silent_s is None:
        silent_s = LINK_SILENT_S + 1.0
    if event in {"pilot", "failsafe"}:
        silent_s = None  # it is received
    _pass(flight, after_s, silent_s)
    actions = flight.actions[since:]
    status = flight.controller.status()
    return Cell(
        state,
        interlock,
        event,
        stood,
        status.state,
        ours,
        flight.controller.in_charge,
        _motions(flight.actions[raised:since]),
        _motions(actions),
        next((a for a in actions if isinstance(a, CommandAck)), None),
        tuple((a.severity, a.text) for a in actions if isinstance(a, Announce)),
        None if status.waiting is None else status.waiting.interlock,
    )


def _motions(actions):
    return tuple(type(action) for action in actions if isinstance(action, MOTIONS))


def entered(flight, since):
    """The states entered since."""
    return [a.target for a in flight.actions[since:] if isinstance(a, StateChanged)]


# As tables for docs/state-machine.md.

_LANDS_OR_NOT_OURS = (State.LAND, State.PASSIVE, State.DONE)
NOT_RAISED = {
    "ALTITUDE_JUMP": ((State.READY, *_LANDS_OR_NOT_OURS), "looked at where the mission cruises"),
    "CONDITIONS": (
        (State.READY, State.HOME, *_LANDS_OR_NOT_OURS),
        "looked at where the mission cruises, and not on the way home",
    ),
    "FOREIGN_ORDER": (
        (State.READY, *_LANDS_OR_NOT_OURS),
        "looked at while a leg or a hold of ours is flown",
    ),
    "RELEASING": (_LANDS_OR_NOT_OURS, "a landing goes on, and what is not ours is not released"),
    "PLAN_CHECK": (_LANDS_OR_NOT_OURS, "a landing needs no plan, nor does what is not ours"),
    "ZONE_UPDATE": ((State.DONE,), "the flight is over"),
}
"""In which states an interlock is not raised (a dash in the table), and why."""


def does(found):
    """What the vehicle is commanded while an interlock stands, in a few words."""
    if not found.stood:
        return "-"
    if not (found.ours and found.ours_at_end):
        return "released" if found.ours else "hands off"
    kinds = {*found.held_back, *found.motions}
    if found.then is not found.state and found.interlock != "none":
        return f"then {found.then.name}"
    if kinds - {HoldHere}:
        return "lands" if kinds == {LandHere} else "flies on"
    if found.waiting is None:
        return "goes on"
    return "holds" if kinds else "sends nothing"


def answers(found):
    """What becomes of an event, in a few words."""
    answer = found.answer
    if answer is not None and not answer.accepted:
        return f"refused: {answer.code.value}"
    if found.ours and not found.ours_at_end:
        return "hands off"
    if found.then is not found.state:
        return f"{found.then.name}, waits" if found.waiting else found.then.name
    if answer is not None:
        return "accepted, waits" if found.waiting else "accepted"
    return "waits" if found.waiting else "goes on"


def table(cells, columns, column_of, words):
    """The lines of a table: a row for each state or interlock, a column for each of `columns`."""
    lines = [f"| | {' | '.join(f'`{column}`' for column in columns)} |"]
    lines.append(f"|---|{'---|' * len(columns)}")
    rows = {}
    for found in cells:
        row, column = column_of(found)
        rows.setdefault(row, {})[column] = words(found)
    for row, texts in rows.items():
        lines.append(f"| {row} | {' | '.join(texts[column] for column in columns)} |")
    return lines


def pages(cells):
    """Both tables of the docs: what is flown, and what becomes of events while it explores."""
    alone = [found for found in cells if found.event == "nothing"]
    yield (
        "states and interlocks",
        table(alone, RAISES, lambda found: (found.state.name, found.interlock), does),
    )
    explores = [found for found in cells if found.state is State.EXPL and found.event != "nothing"]
    yield (
        "events and interlocks",
        table(explores, RAISES, lambda found: (f"`{found.event}`", found.interlock), answers),
    )
