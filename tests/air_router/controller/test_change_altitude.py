"""`altitude`: where the vehicle holds, between the altitudes that zones are checked for."""

import math

import pytest

from air_router.controller.limits import UNDERSPEED_LEG_M
from air_router.controller.model.actions import (
    FlyToNode,
    FlyToPoint,
    HoldHere,
    Refusal,
)
from air_router.controller.model.events import AirspaceChanged, PlanRenewed
from air_router.controller.model.interlocks_raised import Anomaly
from air_router.controller.model.requests import ChangeAltitude, GoOn, HoldNow, LandNow
from air_router.controller.model.states import State
from air_router.mission.loading import load_mission
from air_router.preflight.check_facts import summary
from air_router.preflight.survey import MissionSurvey
from air_router.routing.graph import WaypointGraph
from air_router.routing.return_planner import Pace
from tests.air_router.conftest import MISSIONS

PENNOVATION = MISSIONS / "pennovation" / "mission.yaml"


@pytest.fixture(scope="module")
def mission(tmp_path_factory):
    """Pennovation, flown at 40 m, and on request between 30 and 60 m."""
    path = tmp_path_factory.mktemp("band") / "mission.yaml"
    text = PENNOVATION.read_text(encoding="utf-8").replace("team: ", f"team: {PENNOVATION.parent}/")
    text = text.replace("world: ", f"world: {PENNOVATION.parent}/")
    assert "altitude_m: 40" in text
    path.write_text(f"{text}\naltitudes_m: [30, 60]\n", encoding="utf-8")
    return load_mission(path)


@pytest.fixture
def holding(hovering, mission):
    return hovering(mission)


def sends_to(flight, altitude_m):
    motion = flight.motions[-1]
    return isinstance(motion, FlyToPoint) and motion.altitude_m == altitude_m


@pytest.mark.parametrize(("altitude_m", "verb"), [(60.0, "climbs"), (30.0, "descends")])
def test_it_changes_its_altitude_where_it_holds_and_then_goes_on(holding, altitude_m, verb):
    place = holding.position
    answer = holding.operator_requests(ChangeAltitude(altitude_m, by="kim"))
    assert answer.why == f"it {verb} to {altitude_m:g} m above home, and holds there"
    holding.fly_for(60.0)
    assert holding.altitude_m == pytest.approx(altitude_m)
    assert math.dist(holding.position, place) < 1.0
    assert holding.controller.state is State.HOLD
    assert holding.operator_requests(GoOn()).accepted
    assert isinstance(holding.motions[-1], FlyToNode)  # at the altitude of the plan's item
    assert not [text for text in holding.announced if text.startswith(("too ", "holding: "))]


def test_a_climb_before_the_next_leg_is_not_announced_as_slow(holding):
    assert holding.operator_requests(ChangeAltitude(30.0)).accepted
    holding.fly_for(10.0)
    assert holding.operator_requests(GoOn()).accepted
    moves, holding.wanted = holding.wanted, lambda: (0.0, 0.0)
    while holding.altitude_m < 38.0:
        holding.altitude_m += 1.0 * holding.step_s
        holding.step()
    assert math.dist(holding.position, holding.target) > UNDERSPEED_LEG_M
    holding.wanted = moves
    holding.fly_for(5.0)
    assert not [text for text in holding.announced if "it flies only at" in text]


def test_hold_stops_a_climb_and_land_ends_it(holding):
    assert holding.operator_requests(ChangeAltitude(60.0)).accepted
    holding.fly_for(4.0)
    assert holding.operator_requests(HoldNow()).why == "it stops and hovers"
    assert isinstance(holding.motions[-1], HoldHere)
    assert holding.operator_requests(HoldNow()).why == "it holds already"
    assert holding.operator_requests(ChangeAltitude(35.0)).accepted
    assert holding.operator_requests(LandNow()).accepted


def test_what_interrupts_a_climb_does_not_end_it(holding):
    assert holding.operator_requests(ChangeAltitude(60.0)).accepted
    holding.fly_for(2.0)
    mission = holding.controller.context.airspace.mission
    holding.give(AirspaceChanged(mission.fences, mission.zones[1:]))
    holding.fly_for(1.0)
    commanded = len(holding.motions)
    holding.give(PlanRenewed())
    assert [*map(type, holding.motions[commanded:])] == [FlyToPoint]
    assert sends_to(holding, 60.0)


def test_elsewhere_it_is_refused_and_the_reason_has_what_is_flown(holding, away, pennovation):
    for altitude_m in (29.9, 60.1):
        refused = holding.operator_requests(ChangeAltitude(altitude_m))
        assert refused.code is Refusal.ALTITUDE
        assert "30 to 60 m above home" in refused.why
    assert holding.operator_requests(GoOn()).accepted
    assert holding.operator_requests(ChangeAltitude(50.0)).code is Refusal.BUSY
    holding.fly_for(5.0)
    assert holding.operator_requests(HoldNow()).accepted
    holding.step()
    assert holding.operator_requests(ChangeAltitude(50.0)).code is Refusal.BUSY  # it still moves
    flight = away(pennovation)
    assert flight.operator_requests(HoldNow()).accepted
    flight.fly_for(6.0)
    assert (
        "only 40 m above home is flown; 'altitudes_m'"
        in flight.operator_requests(ChangeAltitude(50.0)).why
    )


def test_why_the_buttons_of_altitude_and_landing_are_refused(
    holding, hovering, pretend, pennovation
):
    def refused(flight):
        return flight.controller.status().refusals

    assert not {"altitude", "land"} & refused(holding).keys()
    assert holding.operator_requests(GoOn()).accepted
    assert refused(holding)["altitude"].endswith("request 'hold' first")
    assert refused(holding)["land"].endswith("request 'hold' first")
    for flight in (hovering(pennovation), pretend(pennovation)):  # in the air and on the ground
        assert refused(flight)["altitude"].startswith("only 40 m above home is flown")


def test_what_may_be_flown_to_is_checked_for_all_zones_and_the_way_down(mission, pennovation):
    assert mission.altitudes_m == (30.0, 60.0)
    assert pennovation.altitudes_m == (40.0, 40.0)
    assert (mission.cruise.lower_m, mission.cruise.upper_m) == (25.0, 65.0)
    assert Pace.of(mission).landing_s == pytest.approx(Pace.of(pennovation).landing_s * 1.5)
    assert mission.waypoints == pennovation.waypoints  # the plan itself is as it was


def test_the_check_prints_which_altitudes_may_be_requested(mission, pennovation):
    planned = "40 m above home at 3.5 m/s"
    for flown, on_request in ((pennovation, ""), (mission, "; 30 to 60 m on request")):
        flies = summary(MissionSurvey(WaypointGraph(flown)))[1]
        assert flies.endswith(f"{planned}{on_request}")


def test_at_a_lower_altitude_of_the_mission_no_leg_climbs_first(holding):
    """Beside a zone it could not, and would wait there for a pilot."""
    assert holding.operator_requests(ChangeAltitude(30.0)).accepted
    holding.fly_for(20.0)
    holding.plan_compared(only_fence=True)
    assert sends_to(holding, 30.0)
    assert holding.operator_requests(GoOn()).accepted
    assert not any("climbing" in text for text in holding.announced)


def test_while_another_order_seems_to_show_no_other_altitude_is_taken(holding):
    """It hovers at the end of its leg in Mission mode, and one report is of another item."""
    holding.shown["item"] = holding.plan.item_of(holding.motions[-1].node) + 1
    holding.step()
    assert holding.controller.context.interlocks.is_raised(Anomaly.FOREIGN_ORDER)
    refused = holding.operator_requests(ChangeAltitude(60.0))
    assert refused.code is Refusal.BUSY
    assert refused.why == "it may be following a foreign command; request it again in a moment"
    del holding.shown["item"]
    holding.step()
    assert holding.operator_requests(ChangeAltitude(60.0)).accepted
    assert sends_to(holding, 60.0)


def test_while_its_altitude_has_jumped_no_other_one_is_taken(holding):
    before_m = holding.altitude_m
    holding.altitude_m = 90.0
    holding.step()
    assert holding.controller.context.interlocks.is_raised(Anomaly.ALTITUDE_JUMP)
    refused = holding.operator_requests(ChangeAltitude(60.0))
    assert refused.code is Refusal.BUSY
    assert refused.why == "the altitude has jumped; request it again once that is over"
    holding.altitude_m = before_m
    holding.fly_for(3.0)
    assert holding.operator_requests(ChangeAltitude(60.0)).accepted


def test_a_climb_that_is_held_for_a_jump_of_the_altitude_goes_on(holding):
    assert holding.operator_requests(ChangeAltitude(60.0)).accepted
    holding.fly_for(2.0)
    holding.altitude_m += 4.0
    holding.step()
    assert isinstance(holding.motions[-1], HoldHere)
    holding.fly_for(20.0)
    assert holding.altitude_m == pytest.approx(60.0)
    held = len(holding.motions)
    holding.altitude_m -= 4.0  # once it is there, it stays where a deviation holds it
    holding.step()
    holding.altitude_m += 4.0
    holding.fly_for(10.0)
    assert [*map(type, holding.motions[held:])] == [HoldHere]


def test_a_climb_that_is_not_followed_is_announced_as_over(holding):
    holding.deaf = True
    assert holding.operator_requests(ChangeAltitude(60.0)).accepted
    holding.deaf = False
    holding.fly_for(4.0)
    assert holding.announced[-2:] == [
        "the vehicle did not follow: deaf",
        "it holds at 40 m above home: it did not follow the command to 60 m",
    ]
    assert isinstance(holding.motions[-1], HoldHere)
    announced = len(holding.announced)
    holding.fly_for(10.0)
    assert holding.announced[announced:] == []
