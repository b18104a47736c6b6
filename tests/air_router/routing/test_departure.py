"""What a first leg has to keep to: one row for each place where a vehicle may stand."""

import math

import pytest

from air_router.routing.departure import RULES, Begins, Departure, Momentum, Stand
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Circle, Zone
from geo.frame import Point
from geo.paths import ShortestPaths
from tests.printed import assert_printed

CLEARANCE_M, MARGIN_M = 5.0, 7.0  # routes keep the margin
ROUND = Airspace(None, [Zone("round", Circle(Point(0.0, 0.0), 20.0))], CLEARANCE_M)
TWO = Airspace(
    None,
    [Zone("round", Circle(Point(0.0, 0.0), 20.0)), Zone("other", Circle(Point(41.0, 0.0), 20.0))],
    CLEARANCE_M,
)
FAR = Point(0.0, 300.0)


def departure(east_m, velocity_m_s=0.0, airspace=ROUND):
    """East of the round zone, flying west at a speed."""
    airspace = airspace.with_margin(MARGIN_M - CLEARANCE_M)
    start, momentum = Point(east_m, 0.0), None
    if velocity_m_s:
        rest = Point(east_m - velocity_m_s, 0.0)
        momentum = Momentum(rest, (-velocity_m_s, 0.0), 5.0, 0.2)
    return Departure(airspace, ShortestPaths(airspace), start, momentum)


@pytest.mark.parametrize(
    ("stand", "leg"),
    [
        (Stand.CLEAR, departure(60.0)),
        (Stand.MOVING, departure(60.0, 4.0)),
        (Stand.NEAR, departure(26.0)),
        (Stand.NEAR, departure(29.0, 3.0)),
        (Stand.TOO_NEAR, departure(24.0)),
        (Stand.TOO_FAST, departure(29.0, 8.0)),
        (Stand.TOO_FAST, departure(24.0, 3.0)),
        (Stand.WITHIN, departure(-10.0)),
        (Stand.WITHIN_NEAR, departure(19.0, airspace=TWO)),
    ],
)
def test_where_a_vehicle_stands_decides_how_its_first_leg_may_begin(stand, leg):
    assert leg.stand is stand
    begins = RULES[stand].begins
    away = Point(math.copysign(80.0, leg.start.east_m), 80.0)
    if begins is Begins.BRAKING:
        assert not leg.allows(away)
        assert not leg.allows(FAR)
    elif begins is Begins.AS_ROUTES or not (leg.moving or stand is Stand.WITHIN_NEAR):
        assert leg.allows(away)
    assert not leg.allows(Point(-3 * leg.start.east_m, 0.1))  # through the zone


def test_only_one_that_should_not_be_there_is_warned_of():
    assert departure(60.0).warnings == departure(26.0).warnings == ()
    assert departure(24.0).warnings == (
        "the vehicle is 4.0 m from no-fly zone 'round': it moves away first",
    )
    assert departure(-10.0).warnings == (
        "the vehicle is inside no-fly zone 'round': it takes the shortest way out",
    )


def first_line(function):
    return "-" if function is None else function.__doc__.splitlines()[0].removesuffix(".")


def table():
    heads = ("the vehicle", "its first leg is", "least distance at first", "and on the whole leg")
    yield f"| {' | '.join(heads)} |"
    yield "|---|---|---|---|"
    for stand, rule in RULES.items():
        cells = (stand.value, rule.begins.value, first_line(rule.first), first_line(rule.whole))
        yield f"| {' | '.join(cells)} |"


def test_every_stand_has_its_rule_and_the_docs_have_the_table():
    assert {*RULES} == {*Stand}
    assert_printed("routes.md", "first legs", table())
