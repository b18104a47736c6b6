"""Whose change of the plan on board is whose, by its ids."""

import pytest

from air_router.vehicle.px4.mavlink_values import FENCE, MISSION, RALLY
from air_router.vehicle.px4.plan_guard import PlanGuard, PlanIds
from air_router.vehicle.vehicle import PlanReplaced, PlanTried

OURS = PlanIds(1, 2, 3)


def guarding(known=OURS):
    guard = PlanGuard()
    guard.begin(known)
    return guard


@pytest.mark.parametrize(
    ("ids", "changed"),
    [
        (OURS, set()),
        (OURS._replace(mission_id=9), {MISSION}),
        (OURS._replace(fence_id=0), {FENCE}),
        (OURS._replace(fence_id=9, rally_points_id=9), {FENCE, RALLY}),
    ],
)
def test_what_no_transfer_of_ours_explains_is_anothers_and_reported_once(ids, changed):
    guard = guarding()
    assert guard.reported(ids) == changed
    assert guard.reported(ids) == set()
    assert guard.changed == changed


def test_what_we_have_put_there_is_ours_and_what_comes_after_it_is_not():
    guard = guarding()
    guard.transfer_begins(MISSION)
    assert guard.reported(OURS) == set()
    guard.stored(MISSION, 7)
    guard.transfer_ends()
    assert guard.reported(OURS._replace(mission_id=7)) == set()
    assert guard.reported(OURS._replace(mission_id=8)) == {MISSION}


def test_what_was_written_over_ours_at_once_is_another():
    guard = guarding()
    guard.transfer_begins(FENCE)
    guard.stored(FENCE, 7)
    guard.transfer_ends()
    assert guard.reported(OURS._replace(fence_id=8)) == {FENCE}


def test_another_list_that_changes_during_a_transfer_of_ours_is_anothers():
    guard = guarding()
    guard.transfer_begins(FENCE)
    assert guard.reported(PlanIds(9, 7, 3)) == {MISSION}


def test_a_transfer_whose_answer_is_lost_may_be_stored_and_one_that_was_refused_is_not():
    for lost, changed in ((True, set()), (False, {RALLY})):
        guard = guarding()
        guard.transfer_begins(RALLY)
        guard.transfer_ends(perhaps_stored=lost)
        assert guard.reported(OURS._replace(rally_points_id=9)) == changed


@pytest.mark.parametrize("reported_before", [True, False])
def test_an_answer_that_is_received_after_the_end_of_the_transfer_counts(reported_before):
    """MAVSDK has reported that it is stored before the answer was received."""
    guard = guarding()
    guard.transfer_begins(FENCE)
    guard.transfer_ends(perhaps_stored=True)
    if reported_before:
        assert guard.reported(OURS._replace(fence_id=7)) == set()
    guard.stored(FENCE, 7)
    assert guard.reported(OURS._replace(fence_id=7)) == set()
    assert guard.reported(OURS._replace(fence_id=8)) == {FENCE}


def test_a_late_answer_shows_that_what_counted_as_ours_before_it_was_not():
    guard = guarding()
    guard.transfer_begins(FENCE)
    guard.transfer_ends(perhaps_stored=True)
    assert guard.reported(OURS._replace(fence_id=8)) == set()
    guard.stored(FENCE, 7)
    assert guard.reported(OURS._replace(fence_id=8)) == {FENCE}


def test_a_list_of_ours_that_is_stored_though_it_was_refused_is_ours():
    """Its refusal names it: the answer was altered on the way."""
    guard = guarding()
    guard.transfer_begins(FENCE)
    guard.refused(FENCE, 7)
    guard.transfer_ends()
    assert guard.reported(OURS._replace(fence_id=7)) == set()
    assert guard.reported(OURS._replace(fence_id=8)) == {FENCE}


def test_a_list_of_ours_that_is_empty_though_its_clearing_was_refused_is_no_other_s():
    guard = guarding()
    guard.transfer_begins(FENCE)
    guard.clear_refused(FENCE)
    guard.transfer_ends()
    assert guard.reported(OURS._replace(fence_id=0)) == set()
    guard.stored(FENCE, 7)
    assert guard.reported(OURS._replace(fence_id=7)) == set()
    assert guard.reported(OURS._replace(fence_id=0)) == {FENCE}


def test_before_anything_is_known_the_first_report_is_what_is_there():
    guard = guarding(None)
    assert guard.reported(OURS) == set()
    assert guard.reported(OURS._replace(mission_id=9)) == {MISSION}


def test_an_answer_to_another_station_on_our_link_is_its_try_and_reported(px4):
    px4.telemetry.guard_plan(None)
    ours = {"target_system": 1, "target_component": 191, "mission_type": 0, "opaque_id": 5}
    px4.sends("MISSION_ACK", **ours, type=1)
    assert not any(isinstance(event, PlanTried) for event in px4.events)
    px4.sends("MISSION_ACK", **ours | {"target_system": 255, "target_component": 190}, type=1)
    (tried,) = (event for event in px4.events if isinstance(event, PlanTried))
    assert "255" in tried.who


@pytest.mark.parametrize(("system", "component", "changed"), [(255, 190, True), (1, 191, False)])
def test_a_list_that_was_stored_for_another_station_is_no_list_of_ours(
    px4, system, component, changed
):
    px4.telemetry.guard_plan(OURS)
    ack = {"target_system": system, "target_component": component, "mission_type": 0, "type": 0}
    px4.sends("MISSION_ACK", **ack, opaque_id=7)
    ids = OURS._replace(mission_id=7)._asdict()
    px4.sends("MISSION_CURRENT", seq=3, total=9, **ids)
    assert any(isinstance(event, PlanReplaced) for event in px4.events) == changed


def test_a_transfer_of_ours_is_no_change_and_one_in_it_is_reported_at_once(px4):
    reported = {"seq": 3, "total": 9, "mission_id": 1, "fence_id": 2, "rally_points_id": 3}
    px4.off.add("MISSION_CURRENT")
    px4.sends("MISSION_CURRENT", **reported)
    px4.telemetry.guard_plan(OURS)
    px4.telemetry.plan.guard.transfer_begins(FENCE)
    ack = {"target_system": 1, "target_component": 191, "mission_type": FENCE, "type": 0}
    px4.sends("MISSION_ACK", **ack, opaque_id=7)
    px4.telemetry.plan.guard.transfer_ends()
    px4.sends("MISSION_CURRENT", **reported | {"fence_id": 7})
    assert not any(isinstance(event, PlanReplaced) for event in px4.events)
    px4.sends("MISSION_CURRENT", **reported | {"fence_id": 7, "mission_id": 4})
    (replaced,) = (event for event in px4.events if isinstance(event, PlanReplaced))
    assert not replaced.only_fence
