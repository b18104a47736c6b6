"""The whole product of states, interlocks and events holds what the flight promises.

Some 1700 cells, each the real controller; `matrix` flies them.
"""

import copy
import dataclasses

import pytest

from air_router.controller.model.actions import HoldHere
from air_router.controller.model.states import State
from air_router.vehicle.vehicle import Severity
from tests.air_router.controller import matrix
from tests.air_router.controller.matrix import EVENTS, NOT_RAISED, RAISES, REQUESTS, STATES
from tests.printed import assert_printed

LONG_S = 150.0
SILENT_S = 75.0  # no vehicle that should move stands so long without an announcement


@pytest.fixture(scope="module")
def begun(pennovation):
    """A flight in each state."""

    def make(*, one_waypoint=False, radius_m=60.0):
        changes = {"waypoints": pennovation.waypoints[:1]} if one_waypoint else {}
        mission = dataclasses.replace(pennovation, duration_s=None, **changes)
        return matrix.Flight(mission, step_s=matrix.STEP_S, radius_m=radius_m)

    flights = {state: fly(make) for state, fly in STATES.items()}
    assert {state: flight.controller.state for state, flight in flights.items()} == {
        state: state for state in State
    }
    return flights


def copied(flight):
    memo = {id(part): part for part in (flight.mission, flight.plan, flight.router)}
    memo |= {id(past): [*past] for past in (flight.track, flight.events, flight.actions)}
    return copy.deepcopy(flight, memo)


@pytest.fixture(scope="module")
def cells(begun):
    return [
        matrix.cell(copied(flight), state, interlock, event)
        for state, flight in begun.items()
        for interlock in RAISES
        for event in EVENTS
    ]


def where(cells):
    return [(cell.state.name, cell.interlock, cell.event, cell.then.name) for cell in cells]


def legs(cell):
    return [kind for kind in cell.motions if kind is not HoldHere]


def test_nothing_leaves_while_another_has_the_vehicle(cells):
    """But for a hold that was on its way, and what the operator requests."""
    theirs = [
        cell
        for cell in cells
        if not cell.ours and not (cell.answer is not None and cell.answer.accepted)
    ]
    taken = [cell for cell in cells if cell.event in {"pilot", "failsafe"}]
    assert len(theirs) > 100
    assert where(cell for cell in [*theirs, *taken] if cell.motions) == []


def test_every_request_is_answered_with_a_sentence(cells):
    requests = [cell for cell in cells if cell.event in REQUESTS]
    assert where(cell for cell in requests if cell.answer is None or not cell.answer.why) == []
    refused = [cell for cell in requests if not cell.answer.accepted]
    assert where(cell for cell in refused if cell.answer.code is None) == []


def test_a_motion_that_is_kept_back_has_a_named_reason(cells):
    sets_out = {"home", "goto", "seek", "explore", "altitude"}
    wanted = [
        cell
        for cell in cells
        if cell.event in sets_out and cell.answer.accepted and cell.ours_at_end
        if cell.state is not State.LAND  # it lands already, as requested
    ]
    assert len(wanted) > 100
    assert where(cell for cell in wanted if not legs(cell) and cell.waiting is None) == []


def test_home_land_and_the_reserve_act_or_have_a_reason(cells):
    """They act, are refused in a sentence, or the pilot is warned."""
    wanted = [
        cell
        for cell in cells
        if cell.event in {"home", "land", "reserve"}
        if cell.ours and not (cell.answer is not None and not cell.answer.accepted)
        if cell.then not in {State.HOME, State.LAND, State.DONE}
    ]
    unannounced = [
        cell for cell in wanted if all(grave is Severity.INFO for grave, _ in cell.announced)
    ]
    assert where(unannounced) == []


@pytest.mark.parametrize("interlock", RAISES)
def test_while_a_vehicle_is_kept_back_the_pilot_is_warned(begun, interlock):
    """Nothing is silent for long: where it should move and does not, that is announced."""
    silent = []
    for state, flight in begun.items():
        found = matrix.cell(copied(flight), state, interlock, "nothing", after_s=LONG_S)
        kept_back = found.stood and found.ours_at_end and found.waiting is not None
        rests = state in {State.HOLD, State.LAND}
        if kept_back and not rests and all(grave is Severity.INFO for grave, _ in found.announced):
            silent.append(state.name)
    assert silent == []


def test_every_cell_is_decided(cells):
    """What is not raised in a state has a reason, and where it stands it is what keeps it back."""
    alone = [cell for cell in cells if cell.event == "nothing"]
    for name in RAISES:
        states, _ = NOT_RAISED.get(name, ((), ""))
        unraised = {cell.state for cell in alone if cell.interlock == name and not cell.stood}
        assert unraised == {*states}, name
    ours = [cell for cell in alone if cell.stood and cell.ours_at_end and cell.state is cell.then]
    resting = {State.READY, State.LAND}  # the climb, and the landing, go on
    unnamed = [cell for cell in ours if cell.waiting != cell.interlock != "none"]
    assert where(cell for cell in unnamed if cell.state not in resting) == []


def test_the_tables_in_the_docs_are_those_of_the_controller(cells):
    for name, lines in matrix.pages(cells):
        assert_printed("state-machine.md", name, lines)
