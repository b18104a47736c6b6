import dataclasses

import pytest

from air_router.energy import battery, farthest_s, up_and_down_s
from air_router.graph import WaypointGraph
from air_router.preflight import Verdict
from air_router.router import Router


@pytest.fixture(scope="session")
def router(pennovation):
    return Router(WaypointGraph(pennovation))


def check(mission, router, charge, **changes):
    return battery(dataclasses.replace(mission, **changes), router, charge, 15.8)


def test_times(pennovation, router):
    assert 40 < up_and_down_s(pennovation) < 90
    farthest_m = max(router.route(w.position, 0).length_m for w in pennovation.waypoints)
    assert farthest_s(pennovation, router) > farthest_m / pennovation.speed_m_s


@pytest.mark.parametrize(
    ("charge", "times", "verdict"),
    [
        (None, (1500.0, None), Verdict.LOOK),
        (0.9, (None, None), Verdict.LOOK),
        (0.4, (None, None), Verdict.BAD),
        (1.0, (1500.0, None), Verdict.GOOD),
        (1.0, (1500.0, 600.0), Verdict.GOOD),
        (1.0, (1500.0, 1400.0), Verdict.LOOK),
        (0.3, (1500.0, None), Verdict.BAD),
        (0.1, (1500.0, None), Verdict.BAD),
    ],
)
def test_the_charge_against_the_mission(pennovation, router, charge, times, verdict):
    endurance_s, duration_s = times
    found = check(pennovation, router, charge, endurance_s=endurance_s, duration_s=duration_s)
    assert found.verdict is verdict, found
    assert found.advice or verdict is Verdict.GOOD
