"""The vocabulary of the state machine: states, signals, and the fields of a state's row.

INIT, SEARCH, COMM and EXPL are those of the paper (its figure "State machine describing the
communication-aware exploration"); the others take the vehicle off the ground, bring it home and
give it away. The table itself is `states.table.STATES`.
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
    IDLE = "waiting: everything is explored and every robot has been met"
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
    TIMER = "the state's time has expired"
    EXPLORED = "every waypoint has been visited"
    FOUND = "a message of the sought robot arrived"
    SYNCED = "both directions have synced"
    NO_TARGET = "no robot can be sought now"
    ALL_MET = "everything is explored and no robot is due for a visit"
    ROBOT_DUE = "a robot is due for another visit"
    COME_HOME = "duration, battery reserve or the operator's request"
    ARRIVED = "above home"
    GROUNDED = "landed and disarmed"
    TAKEN_OVER = "the pilot or the autopilot changed the mode"
    RESUMED = "the operator requested 'resume'"
    HOLD = "hold requested"
    SEEK = "search for a robot requested"
    EXPLORE = "exploration requested"
    GOTO = "flight to points requested"
    LAND_HERE = "landing in place requested"
    NO_WAY = "no clear way to the remaining points"
    YIELDED = "another UAV seeks the same robot"


class TimerStart(Enum):
    """When the timer of a state begins."""

    ENTRY = "when the state is entered"
    ARRIVAL = "when the vehicle has arrived where the state sends it"


class CommandPolicy(Enum):
    """What may be requested of a vehicle in a state."""

    ANY = "it may be sent anywhere"
    CALL_OFF = "it may be sent elsewhere if its way home may be called off"
    NOT_YET = "the mission has not begun in the air yet"
    NOT_OURS = "the pilot or a failsafe has the vehicle"
    OVER = "the flight is over"


@dataclass(frozen=True, slots=True)
class StateSpec:
    """All that is true of one state.

    Attributes:
        handler: Class of what is flown in it; the controller has one instance of each.
        on: Which state follows a signal. One that is not here changes nothing.
        requests: What may be requested of the vehicle.
        timer: The field of the mission's `timers` that limits it; None: no limit.
        timer_from: When that begins.
        keeps_target: The robot that was sought is remembered.
        seeks: That robot is sought, or hovered over, just now.
        explores: It flies the waypoints in order.
        cruises: It flies at the mission's altitude, so deviations from that are searched for.
        puts_off: Points that came by gossip wait for the state's end instead of being refused.
        ours: We command the vehicle.
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
    puts_off: bool = False
    ours: bool = True
