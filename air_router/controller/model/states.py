"""States and signals of the mission's state machine, and the fields of a state's row.

INIT, SEARCH, COMM and EXPL come from the paper (its figure "State machine describing the
communication-aware exploration"). The other states cover take-off, return, landing, and a vehicle
that a pilot flies. `states.table.STATES` is the table itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any


class State(Enum):
    """What the mission is doing."""

    READY = "on the ground or climbing, until the vehicle hovers above home"
    INIT = "exploring the waypoints for the first time"
    SEARCH = "flying to where a robot should be"
    COMM = "hovering over a robot while data are exchanged"
    IDLE = "hovering: everything is explored and every robot has been met"
    EXPL = "resuming exploration"
    GOTO = "flying to requested points"
    HOLD = "hovering on request"
    HOME = "flying home along the graph"
    LAND = "landing"
    DONE = "landed and disarmed"
    PASSIVE = "the pilot or a failsafe flies: hands off"


class Signal(Enum):
    """What can happen to a mission."""

    AIRBORNE = "the vehicle hovers above home"
    TIMER = "the state's timer expired"
    EXPLORED = "every waypoint has been visited"
    FOUND = "a message was received over the robot's own link"
    SYNCED = "both directions have synced"
    NO_TARGET = "no robot can be sought now"
    ALL_MET = "everything is explored and no robot is due for a visit"
    ROBOT_DUE = "a robot is due for another visit"
    COME_HOME = "duration, battery reserve or the operator's request"
    ARRIVED = "arrived above home"
    GROUNDED = "landed and disarmed"
    TAKEN_OVER = "the pilot or the autopilot changed the mode"
    RESUMED = "the operator requested to resume"
    HOLD = "hold was requested"
    SEEK = "a search for a robot was requested"
    EXPLORE = "exploration was requested"
    GOTO = "a flight to points was requested"
    LAND_HERE = "landing in place was requested"
    NO_WAY = "no clear route to the remaining points"
    YIELDED = "another UAV seeks the same robot"


class TimerStart(Enum):
    """When a state's timer starts."""

    ENTRY = "when the state is entered"
    ARRIVAL = "when the vehicle has arrived at the state's destination"


class CommandPolicy(Enum):
    """Which requests a state accepts."""

    ANY = "every request is accepted"
    CALL_OFF = "requests are accepted if the flight home may be canceled"
    NOT_YET = "the mission has not begun in the air yet"
    NOT_OURS = "the pilot or a failsafe has the vehicle"
    OVER = "the flight is over"


@dataclass(frozen=True, slots=True)
class StateSpec:
    """One state's row in the table.

    Attributes:
        handler: Class that handles the state; the controller has one instance of each.
        on: Next state by signal. Other signals have no effect.
        requests: Which requests the state accepts.
        timer: The field of the mission's `timers` that limits the state; None: no limit.
        timer_from: When the timer starts.
        keeps_target: The sought robot is remembered.
        seeks: The vehicle flies to that robot or hovers over it.
        explores: The vehicle flies the waypoints in order.
        cruises: The vehicle flies at the mission's altitude, so deviations from it are monitored.
        defers: Points received by gossip wait for the end of the state instead of being refused.
        ours: This program commands the vehicle.
    """

    handler: type[Any] = object
    on: Mapping[Signal, State] = field(default_factory=dict)
    requests: CommandPolicy = CommandPolicy.ANY
    timer: str | None = None
    timer_from: TimerStart = TimerStart.ENTRY
    keeps_target: bool = False
    seeks: bool = False
    explores: bool = False
    cruises: bool = False
    defers: bool = False
    ours: bool = True
