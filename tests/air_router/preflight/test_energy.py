import dataclasses

import pytest

from air_router.preflight.energy import CLIMB_M_S, battery
from air_router.preflight.preflight import CheckVerdict
from air_router.routing.graph import WaypointGraph
from air_router.routing.return_planner import LANDING_MARGIN, ReturnPlanner
from air_router.routing.router import Router


@pytest.fixture(scope="session")
def router(pennovation):
    return Router(WaypointGraph(pennovation))


def check(mission, router, charge, **changes):
    return battery(dataclasses.replace(mission, **changes), router, charge, 15.8)


def test_what_is_good_on_the_ground_reaches_the_farthest_waypoint_in_flight(pennovation, router):
    return_planner = ReturnPlanner(router)
    _, way = return_planner.worst_waypoint
    out_s = pennovation.altitude_above_home_m / CLIMB_M_S + return_planner.pace.time_s(way)
    for reserve in (0.0, 0.25):
        turning = max(reserve, return_planner.pace.home_s(way) / 1500 + LANDING_MARGIN)
        for spare, verdict in ((0.001, CheckVerdict.GOOD), (-0.001, CheckVerdict.BAD)):
            charge = turning + out_s / 1500 + spare
            wanted = {"endurance_s": 1500.0, "duration_s": None, "battery_reserve": reserve}
            assert check(pennovation, router, charge, **wanted).verdict is verdict


@pytest.mark.parametrize(
    ("charge", "times", "verdict"),
    [
        (None, (1500.0, None), CheckVerdict.LOOK),
        (0.9, (None, None), CheckVerdict.LOOK),
        (0.4, (None, None), CheckVerdict.BAD),
        (1.0, (1500.0, None), CheckVerdict.GOOD),
        (1.0, (1500.0, 600.0), CheckVerdict.GOOD),
        (1.0, (1500.0, 1400.0), CheckVerdict.LOOK),
        (0.3, (1500.0, None), CheckVerdict.BAD),
        (0.1, (1500.0, None), CheckVerdict.BAD),
    ],
)
def test_the_charge_against_the_mission(pennovation, router, charge, times, verdict):
    endurance_s, duration_s = times
    found = check(pennovation, router, charge, endurance_s=endurance_s, duration_s=duration_s)
    assert found.verdict is verdict, found
    assert found.advice or verdict is CheckVerdict.GOOD
