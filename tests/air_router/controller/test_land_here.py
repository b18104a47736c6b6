"""`land`: where the vehicle hovers, when it hovers, and only where nothing is below."""

import math

import pytest

from air_router.controller.model.actions import HoldHere, LandHere, Refusal
from air_router.controller.model.events import AirspaceChanged
from air_router.controller.model.requests import ComeHome, GoOn, HoldNow, LandNow
from air_router.controller.model.states import State
from air_router.mission.flight_plan import HOME_NODE
from air_router.mission.loading import load_mission
from air_router.vehicle.vehicle import ItemReached
from geo.airspace.zone import Band, Circle, Zone
from geo.frame import Point
from tests.air_router.conftest import MISSIONS


@pytest.fixture
def holding(hovering):
    return hovering()


def test_it_lands_where_it_hovers_and_nothing_calls_that_off(holding):
    place = holding.position
    assert holding.operator_requests(LandNow(by="kim")).accepted
    assert holding.motions[-1] == LandHere()
    assert holding.controller.state is State.LAND
    assert holding.operator_requests(LandNow()).why == "it lands already"
    assert holding.operator_requests(ComeHome()).why == "it lands already"
    refused = holding.operator_requests(HoldNow())
    assert (refused.code, refused.why) == (
        Refusal.COMING_HOME,
        "it lands: kim requested to land here",
    )
    holding.ends()
    assert math.dist(holding.position, place) < 1.0
    assert holding.finished.why == "landed where it hovered, requested by kim"


def test_above_home_a_landing_that_is_not_followed_is_commanded_again_until_it_lands(away):
    flight = away(duration_s=4000.0)
    flight.operator_requests(ComeHome())
    flight.fly_until(lambda: math.dist(flight.position, flight.mission.home) < 4.0)
    flight.deaf = True
    flight.fly_to_state(State.LAND, 60.0)
    flight.fly_for(10.0)
    assert flight.motions.count(LandHere()) > 2
    flight.deaf = False
    flight.lands(300.0)


def test_a_requested_landing_is_flown_while_its_altitude_has_jumped(holding):
    holding.altitude_m += 12.0
    holding.step()
    assert "the altitude jumped" in holding.announced[-1]
    assert holding.operator_requests(LandNow()).accepted
    holding.lands(300.0)


def test_above_home_it_does_not_land_while_its_altitude_has_jumped(away):
    flight = away(duration_s=4000.0)
    flight.operator_requests(ComeHome())
    flight.fly_until(lambda: math.dist(flight.position, flight.mission.home) < 4.0)
    flight.altitude_m += 12.0
    flight.step()
    flight.give(ItemReached(flight.now_s, flight.plan.item_of(HOME_NODE)))
    assert flight.controller.state is State.HOME
    flight.fly_for(5.0)
    flight.altitude_m -= 12.0
    flight.lands(300.0)


def test_it_holds_first_and_stands_still(away):
    flight = away(duration_s=4000.0)
    refused = flight.operator_requests(LandNow())
    assert (refused.code, refused.why) == (
        Refusal.BUSY,
        "it lands where it hovers: request 'hold' first",
    )
    flight.operator_requests(HoldNow())
    refused = flight.operator_requests(LandNow())
    assert "it does not hover yet" in refused.why
    assert flight.controller.state is State.HOLD


def test_it_does_not_land_through_the_layer_of_another_uav(away):
    mission = load_mission(MISSIONS / "pair" / "mission.yaml", uav="titan")
    flight = away(mission)
    flight.operator_requests(HoldNow())
    flight.fly_for(6.0)
    refused = flight.operator_requests(LandNow())
    assert (refused.code, flight.controller.state) == (Refusal.NO_WAY, State.HOLD)
    assert refused.why == "the layer of atlas is below; it lands at home only: 'home'"
    assert flight.operator_requests(ComeHome()).accepted
    flight.ends()
    assert math.dist(flight.position, mission.home) < 3.0


@pytest.mark.parametrize("band", [None, Band(-math.inf, 15.0), Band(35.0, 60.0)], ids=str)
@pytest.mark.parametrize(("offset_m", "lands"), [(0.5, False), (3.0, True)])
def test_no_zone_may_be_below_nor_so_near_that_it_drifts_there(holding, band, offset_m, lands):
    mission = holding.mission
    kept_m = mission.planner.clearance_m + mission.planner.tracking_margin_m
    east_m, north_m = holding.position
    centre = Point(east_m + 3.0 + mission.planner.clearance_m + offset_m, north_m)
    hut = Zone("hut", Circle(centre, 3.0), band=band)
    holding.give(AirspaceChanged(mission.fences, (*mission.zones, hut)))
    holding.fly_for(6.0)
    assert (math.dist(holding.position, centre) - 3.0 > kept_m) is lands
    answer = holding.operator_requests(LandNow())
    assert answer.accepted is lands
    if not lands:
        assert answer.code is Refusal.NO_WAY
        assert "hut" in answer.why
        assert LandHere() not in holding.motions


def test_a_mission_that_goes_on_lands_at_home_again(holding):
    assert holding.operator_requests(LandNow(by="kim")).accepted
    holding.pilot_chooses(type(holding.mode).POSITION)
    assert holding.controller.state is State.PASSIVE
    holding.pilot_chooses(type(holding.mode).HOLD)
    assert holding.operator_requests(GoOn()).accepted
    assert holding.operator_requests(ComeHome()).accepted
    holding.ends()
    assert holding.finished.why == "landed at home"


def test_a_zone_that_is_drawn_below_its_landing_is_not_landed_into(holding):
    holding.operator_requests(LandNow())
    holding.fly_for(5.0)
    high_m, mission = holding.altitude_m, holding.mission
    zone = Zone("new", Circle(holding.position, 10.0), band=Band(-math.inf, 15.0))
    holding.give(AirspaceChanged(mission.fences, (*mission.zones, zone)))
    holding.fly_for(30.0)
    assert high_m - holding.altitude_m < 1.0
    assert holding.controller.state is State.PASSIVE


def test_where_a_zone_is_drawn_over_its_landing_it_lands_nowhere_else(holding):
    """What is below was looked at for its place alone: the pilot has it."""
    holding.operator_requests(LandNow())
    holding.fly_for(20.0)
    place, mission = holding.position, holding.mission
    zone = Zone("new", Circle(Point(place.east_m + 8.0, place.north_m), 10.0))
    holding.give(AirspaceChanged(mission.fences, (*mission.zones, zone)))
    holding.fly_for(3.0)
    assert isinstance(holding.motions[-1], HoldHere)
    assert holding.controller.state is State.PASSIVE
    assert holding.announced[-2] == "hands off: breach of new is not resumed by itself"
