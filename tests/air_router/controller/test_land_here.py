"""`land`: where the vehicle hovers, when it hovers, and only where nothing is below."""

import math

import pytest

from air_router.controller.model.actions import CommandAck, HoldHere, LandHere, Refusal
from air_router.controller.model.events import AirspaceChanged
from air_router.controller.model.requests import ComeHome, GoOn, HoldNow, LandNow
from air_router.controller.model.states import State
from air_router.mission.flight_plan import HOME_NODE
from air_router.mission.loading import load_mission
from air_router.vehicle.vehicle import ItemReached
from geo.airspace.zone import Band, Circle, Zone
from geo.frame import Point
from tests.air_router.conftest import MISSIONS


def asked(flight, request):
    flight.operator_asks(request)
    return next(a for a in reversed(flight.actions) if isinstance(a, CommandAck))


@pytest.fixture
def holding(pretend):
    """A flight that hovers on request, somewhere on its way."""
    flight = pretend(duration_s=4000.0)
    flight.hold_away()
    return flight


def test_it_lands_where_it_hovers_and_nothing_calls_that_off(holding):
    place = holding.position
    assert asked(holding, LandNow(by="kim")).accepted
    assert holding.motions[-1] == LandHere()
    assert holding.controller.state is State.LAND
    assert asked(holding, LandNow()).why == "it lands already"
    assert asked(holding, ComeHome()).why == "it lands already"
    assert asked(holding, HoldNow()).code is Refusal.COMING_HOME
    holding.fly_until(lambda: holding.finished is not None)
    assert math.dist(holding.position, place) < 1.0
    assert holding.finished.why == "landed where it hovered, as kim asked"


def test_asked_to_while_its_altitude_has_jumped_it_lands(holding):
    holding.altitude_m += 12.0
    holding.step()
    assert "the altitude jumped" in holding.said[-1]
    assert asked(holding, LandNow()).accepted
    holding.fly_until(lambda: holding.finished is not None, 300.0)
    assert holding.finished.landed_by_us


def test_above_home_it_does_not_land_while_its_altitude_has_jumped(pretend):
    flight = pretend(duration_s=4000.0)
    flight.take_off()
    flight.fly_away()
    asked(flight, ComeHome())
    flight.fly_until(lambda: math.dist(flight.position, flight.mission.home) < 4.0)
    flight.altitude_m += 12.0
    flight.step()
    flight.give(ItemReached(flight.now_s, flight.plan.item_of(HOME_NODE)))
    assert flight.controller.state is State.HOME
    flight.fly_for(5.0)
    flight.altitude_m -= 12.0
    flight.fly_until(lambda: flight.finished is not None, 300.0)
    assert flight.finished.landed_by_us


def test_it_holds_first_and_stands_still(pretend):
    flight = pretend(duration_s=4000.0)
    flight.take_off()
    flight.fly_away()
    refused = asked(flight, LandNow())
    assert (refused.code, refused.why) == (
        Refusal.BUSY,
        "it lands where it hovers: have it hold first",
    )
    flight.operator_asks(HoldNow())
    refused = asked(flight, LandNow())
    assert "it does not hover yet" in refused.why
    assert flight.controller.state is State.HOLD


def test_it_does_not_land_through_the_layer_of_another_uav(pretend):
    mission = load_mission(MISSIONS / "pair" / "mission.yaml", uav="titan")
    flight = pretend(mission)
    flight.take_off()
    flight.fly_away()
    asked(flight, HoldNow())
    flight.fly_for(6.0)
    refused = asked(flight, LandNow())
    assert (refused.code, flight.controller.state) == (Refusal.NO_WAY, State.HOLD)
    assert refused.why == "the layer of atlas is below; it lands at home only: 'home'"
    assert asked(flight, ComeHome()).accepted
    flight.fly_until(lambda: flight.finished is not None)
    assert math.dist(flight.position, mission.home) < 3.0


@pytest.mark.parametrize("band", [None, Band(-math.inf, 15.0), Band(35.0, 60.0)], ids=str)
@pytest.mark.parametrize(("beside_m", "lands"), [(0.5, False), (3.0, True)])
def test_no_zone_may_be_below_nor_so_near_that_it_drifts_there(holding, band, beside_m, lands):
    mission = holding.mission
    kept_m = mission.planner.clearance_m + mission.planner.tracking_margin_m
    east_m, north_m = holding.position
    centre = Point(east_m + 3.0 + mission.planner.clearance_m + beside_m, north_m)
    hut = Zone("hut", Circle(centre, 3.0), band=band)
    holding.give(AirspaceChanged(mission.fences, (*mission.zones, hut)))
    holding.fly_for(6.0)
    assert (math.dist(holding.position, centre) - 3.0 > kept_m) is lands
    answer = asked(holding, LandNow())
    assert answer.accepted is lands
    if not lands:
        assert answer.code is Refusal.NO_WAY
        assert "hut" in answer.why
        assert LandHere() not in holding.motions


def test_a_mission_that_goes_on_lands_at_home_again(holding):
    assert asked(holding, LandNow(by="kim")).accepted
    holding.pilot_chooses(type(holding.mode).POSITION)
    assert holding.controller.state is State.PASSIVE
    holding.pilot_chooses(type(holding.mode).HOLD)
    assert asked(holding, GoOn()).accepted
    assert asked(holding, ComeHome()).accepted
    holding.fly_until(lambda: holding.finished is not None)
    assert holding.finished.why == "landed at home"


def test_where_a_zone_is_drawn_over_its_landing_it_lands_nowhere_else(holding):
    """What is below was looked at for its place alone: the pilot has it."""
    asked(holding, LandNow())
    holding.fly_for(20.0)
    place, mission = holding.position, holding.mission
    zone = Zone("new", Circle(Point(place.east_m + 8.0, place.north_m), 10.0))
    holding.give(AirspaceChanged(mission.fences, (*mission.zones, zone)))
    holding.fly_for(3.0)
    assert isinstance(holding.motions[-1], HoldHere)
    assert holding.controller.state is State.PASSIVE
    assert holding.said[-2] == "hands off: breach of new is not resumed by itself"
