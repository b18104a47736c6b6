import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.world.radio import PairPowers, RadioModel

UAV = (0.0, 0.0, 40.0)


def ugv(east_m: float) -> tuple[float, float, float]:
    return east_m, 0.0, 0.5


def power_dbm(radio, one, other, time_s=0.0, names=("io", "titan", 0)) -> float:
    """What both of two radios receive of each other; behind their names stands the seed."""
    away_m = np.array([math.dist(one, other)])
    low = np.array([max(one[2], other[2]) < 1.5])
    pair = np.array([0]), np.array([1])
    powers = PairPowers(radio, names[:2], names[2])
    return powers.rssi_dbm(*pair, away_m, low, time_s)[0]


def test_the_default_radio_reaches_as_far_as_documented():
    radio = RadioModel()
    slant_m = radio.range_m(radio.sensitivity_dbm)
    assert 60 < math.sqrt(slant_m**2 - 39.5**2) < 70
    assert 33 < radio.range_m(radio.sensitivity_dbm + radio.ground_to_ground_loss_db) < 37


@pytest.mark.parametrize(("east_m", "received"), [(0.0, True), (60.0, True), (75.0, False)])
def test_the_vehicle_receives_robots_within_its_horizontal_range(east_m, received):
    radio = RadioModel()
    assert (power_dbm(radio, UAV, ugv(east_m)) >= radio.sensitivity_dbm) == received


def test_robots_on_the_ground_pay_an_extra_loss():
    radio = RadioModel(ground_to_ground_loss_db=12.0)
    free = radio.mean_rssi_dbm(np.array([50.0]), np.array([False]))[0]
    assert power_dbm(radio, ugv(0.0), ugv(50.0)) == pytest.approx(free - 12.0)


def test_on_top_of_each_other_the_power_is_finite():
    assert power_dbm(RadioModel(), ugv(0.0), ugv(0.0)) == pytest.approx(-30.5)


@given(
    time_s=st.floats(0, 1e6),
    step_s=st.floats(0, 0.1),
    east_m=st.floats(-500, 500),
    seed=st.integers(0, 10),
)
def test_shadowing_is_symmetric_repeatable_bounded_and_slow(time_s, step_s, east_m, seed):
    radio = RadioModel(shadowing_db=4.0)
    plain = power_dbm(RadioModel(), ugv(east_m), UAV, time_s)
    value = power_dbm(radio, ugv(east_m), UAV, time_s, ("io", "titan", seed))
    assert value == power_dbm(radio, UAV, ugv(east_m), time_s, ("titan", "io", seed))
    assert abs(value - plain) <= 12.0 + 1e-9
    later = power_dbm(radio, ugv(east_m), UAV, time_s + step_s, ("io", "titan", seed))
    assert abs(later - value) < 2.0


def test_shadowing_has_the_deviation_that_is_set_and_differs_between_pairs_and_seeds():
    radio, plain_dbm = RadioModel(shadowing_db=3.0), power_dbm(RadioModel(), UAV, UAV)

    def loss_db(time_s, other="b", seed=0):
        return plain_dbm - power_dbm(radio, UAV, UAV, time_s, ("a", other, seed))

    still = [loss_db(number * 3.7) for number in range(1000)]
    mean = sum(still) / len(still)
    assert abs(mean) < 0.6
    assert math.sqrt(sum((v - mean) ** 2 for v in still) / len(still)) == pytest.approx(
        3.0, rel=0.15
    )
    assert len({loss_db(5.0), loss_db(5.0, other="c"), loss_db(5.0, seed=1)}) == 3


@pytest.mark.parametrize("shadowing_db", [0.0, 4.0])
def test_many_pairs_at_once_have_the_powers_of_each(shadowing_db):
    radio, names = RadioModel(shadowing_db=shadowing_db), ("io", "europa", "titan")
    places = (ugv(0.0), ugv(30.0), UAV)
    powers = PairPowers(radio, names, 3)
    a, b = np.array([0, 0, 1]), np.array([1, 2, 2])
    away_m = np.array([math.dist(places[i], places[j]) for i, j in zip(a, b, strict=True)])
    low = np.array([True, False, False])
    for time_s in (0.0, 4.0, 9.9, 10.0, 47.0):
        own = [
            power_dbm(radio, places[i], places[j], time_s, (names[i], names[j], 3))
            for i, j in zip(a, b, strict=True)
        ]
        assert powers.rssi_dbm(a, b, away_m, low, time_s).tolist() == own


def test_no_robot_receives_beyond_the_longest_range():
    radio = RadioModel(shadowing_db=2.0)
    reach_m = radio.longest_range_m
    beyond = [power_dbm(radio, UAV, (reach_m + 0.1, 0.0, 40.0), float(t)) for t in range(1000)]
    assert max(beyond) < radio.sensitivity_dbm
