"""What keeps a motion back: each row of the table alone, two at once, and what is shown of it."""

from itertools import combinations

import pytest

from air_router.controller.model.actions import FlyToPoint, HoldHere, LandHere, MissionWaits
from air_router.controller.model.interlocks_raised import Anomaly
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.interlocks import INTERLOCKS, raised
from air_router.vehicle.input_limits import InputResponse
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point
from sitl.rehearsal.faults import Fault
from tests.printed import assert_printed

HERE = Point(0.0, 0.0)
LEG = FlyToPoint(Point(50.0, 0.0), 40.0)


def anomaly(found):
    return (
        lambda context: context.interlocks.put(found, raised=True),
        lambda context: context.interlocks.put(found, raised=False),
    )


RAISED = {  # how each is raised, and how it clears
    "LINK_SILENT": (
        lambda context: context.silent_for(1.0),
        lambda context: context.silent_for(0.0),
    ),
    "INPUT_MISSING": (
        lambda context: context.inputs.stopped.update(
            {"position not received": InputResponse.HOLD}
        ),
        lambda context: context.inputs.stopped.clear(),
    ),
    "ALTITUDE_JUMP": anomaly(Anomaly.ALTITUDE_JUMP),
    "CONDITIONS": anomaly(Anomaly.CONDITIONS),
    "FOREIGN_ORDER": anomaly(Anomaly.FOREIGN_ORDER),
    "RELEASING": (
        lambda context: context.authority.release("a breach"),
        lambda context: context.authority.released(),
    ),
    "PLAN_CHECK": (
        lambda context: context.authority.check_plan("the plan on board was replaced"),
        lambda context: context.authority.plan_checked(),
    ),
    "ZONE_UPDATE": (
        lambda context: context.airspace.clear(),
        lambda context: context.airspace.finish_change(),
    ),
}
NAMES = [row.name for row in INTERLOCKS]


@pytest.fixture
def context(pennovation):
    return MissionContext(pennovation, None)


@pytest.fixture
def gate(context):
    gate = CommandGate(context, None)
    gate.assume(FlightMode.HOLD)
    return gate


def raise_(context, *names):
    for name in names:
        RAISED[name][0](context)


def test_every_row_is_raised_by_something_and_flown_in_a_scene():
    assert [*RAISED] == NAMES
    assert [row.name for row in INTERLOCKS if row.scene not in Fault.__members__] == []


@pytest.mark.parametrize("name", NAMES)
def test_a_row_keeps_legs_and_landings_back_and_is_shown_until_it_clears(context, gate, name):
    raise_(context, name)
    context.begin(7.0)
    gate.command(LEG)
    gate.command(LandHere())
    assert not [a for a in context.actions if not isinstance(a, HoldHere)]
    assert (gate.waits_for().by.name, gate.waits_for().since_s) == (name, 7.0)
    RAISED[name][1](context)
    assert gate.waits_for() is None
    gate.command(LEG)
    assert context.actions[-1] is LEG
    assert gate.blocked is None


def test_a_hold_leaves_whatever_is_raised_while_the_vehicle_is_received(context, gate):
    hold = HoldHere("why")
    raise_(context, *(name for name in NAMES if name != "LINK_SILENT"))
    gate.command(hold)
    assert context.actions == [hold]


@pytest.mark.parametrize("names", list(combinations(NAMES, 2)))
def test_of_two_rows_the_first_decides(context, gate, names):
    raise_(context, *names)
    gate.command(LEG)
    assert [row.name for row in raised(context)] == [*names]
    assert gate.waits_for().by.name == names[0]
    assert not [a for a in context.actions if not isinstance(a, HoldHere)]


@pytest.mark.parametrize("names", [["FOREIGN_ORDER"], ["INPUT_MISSING", "LINK_SILENT"]])
def test_what_is_in_doubt_is_planned_anew_whichever_row_decides(context, gate, names):
    raise_(context, *names)
    gate.command(LEG)
    assert context.interlocks.motion_deferred


@pytest.mark.parametrize("name", NAMES)
def test_a_landing_that_is_kept_back_is_commanded_again_where_nothing_else_does_it(
    context, gate, name
):
    raise_(context, name)
    gate.command(LandHere())
    (row,) = (row for row in INTERLOCKS if row.name == name)
    assert (context.task.retry_at_s is not None) == row.repeats_landing


def test_what_is_missing_is_named(context, gate):
    raise_(context, "INPUT_MISSING")
    gate.command(LEG)
    assert gate.waits_for().why(context) == "position not received"
    RAISED["INPUT_MISSING"][1](context)
    context.telemetry = Telemetry(1.0, HERE, 40.0, fix=False)
    assert gate.waits_for().why(context) == "GPS has no fix"


def test_how_long_it_waits_counts_from_the_row_that_decides_now(context, gate):
    raise_(context, "ZONE_UPDATE")
    gate.command(LEG)
    context.now_s = 5.0
    raise_(context, "ALTITUDE_JUMP")
    gate.command(LEG)
    context.now_s = 8.0
    gate.command(LEG)
    assert (gate.waits_for().by.name, gate.waits_for().since_s) == ("ALTITUDE_JUMP", 5.0)


def table():
    head = "interlock | the vehicle meanwhile | cleared when; then | if not | why here | scene"
    lines = [f"| {head} |"]
    lines.append("|---|---|---|---|---|---|")
    for row in INTERLOCKS:
        cleared = f"{row.clears}; {row.then}"
        cells = (f"`{row.name}`: {row.words}", row.while_up, cleared, row.otherwise, row.why)
        lines.append(f"| {' | '.join(cells)} | `{row.scene}` |")
    return lines


def test_the_table_in_the_docs_is_the_one_that_decides():
    assert_printed("state-machine.md", "interlocks", table())


def test_each_change_of_what_keeps_the_mission_waiting_is_decided_once(airborne):
    flight = airborne()
    flight.fix = False
    flight.fly_for(6.0)
    flight.fix = True
    flight.fly_for(6.0)
    waits = [action for action in flight.actions if isinstance(action, MissionWaits)]
    assert [change.interlock for change in waits] == ["INPUT_MISSING", None]
    assert waits[0].why == "GPS has no fix"
    assert flight.now_s - 12.0 <= waits[0].since_s <= flight.now_s - 6.0
    assert flight.controller.status().waiting is None
