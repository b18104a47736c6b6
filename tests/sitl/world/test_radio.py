import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.world.radio import Antenna, PairPowers, RadioModel

UAV = Antenna(0.0, 0.0, 40.0, on_ground=False)


def ugv(east_m: float) -> Antenna:
    return Antenna(east_m, 0.0, 0.5, on_ground=True)


def test_the_default_radio_reaches_as_far_as_the_world_file_says():
    radio = RadioModel()
    slant_m = radio.range_m(radio.sensitivity_dbm)
    assert 60 < math.sqrt(slant_m**2 - 39.5**2) < 70
    assert 33 < radio.range_m(radio.sensitivity_dbm, ground_to_ground=True) < 37


@pytest.mark.parametrize(("east_m", "heard"), [(0.0, True), (60.0, True), (75.0, False)])
def test_the_vehicle_hears_robots_within_its_horizontal_range(east_m, heard):
    radio = RadioModel()
    rssi_dbm = radio.rssi_dbm("titan", UAV, "io", ugv(east_m), 0.0)
    assert radio.hears(rssi_dbm) is heard


def test_robots_on_the_ground_pay_an_extra_loss():
    radio = RadioModel(ground_to_ground_loss_db=12.0)
    high = Antenna(0.0, 0.0, 0.5, on_ground=False)
    low = Antenna(0.0, 0.0, 0.5, on_ground=True)
    free = radio.rssi_dbm("a", high, "b", ugv(50.0), 0.0)
    assert radio.rssi_dbm("a", low, "b", ugv(50.0), 0.0) == pytest.approx(free - 12.0)


def test_on_top_of_each_other_the_power_is_finite():
    assert RadioModel().rssi_dbm("a", ugv(0.0), "b", ugv(0.0), 0.0) == pytest.approx(-30.5)


@given(
    time_s=st.floats(0, 1e6),
    step_s=st.floats(0, 0.1),
    east_m=st.floats(-500, 500),
    seed=st.integers(0, 10),
)
def test_shadowing_is_symmetric_repeatable_bounded_and_slow(time_s, step_s, east_m, seed):
    radio = RadioModel(shadowing_db=4.0, seed=seed)
    plain = RadioModel().rssi_dbm("io", ugv(east_m), "titan", UAV, time_s)
    value = radio.rssi_dbm("io", ugv(east_m), "titan", UAV, time_s)
    assert value == radio.rssi_dbm("titan", UAV, "io", ugv(east_m), time_s)
    assert abs(value - plain) <= 12.0 + 1e-9
    later = radio.rssi_dbm("io", ugv(east_m), "titan", UAV, time_s + step_s)
    assert abs(later - value) < 2.0


def test_shadowing_has_the_deviation_asked_for_and_differs_between_pairs_and_seeds():
    plain_dbm = RadioModel().rssi_dbm("a", UAV, "b", UAV, 0.0)

    def loss_db(time_s, other="b", seed=0):
        radio = RadioModel(shadowing_db=3.0, seed=seed)
        return plain_dbm - radio.rssi_dbm("a", UAV, other, UAV, time_s)

    still = [loss_db(number * 3.7) for number in range(1000)]
    mean = sum(still) / len(still)
    assert abs(mean) < 0.6
    assert math.sqrt(sum((v - mean) ** 2 for v in still) / len(still)) == pytest.approx(
        3.0, rel=0.15
    )
    assert len({loss_db(5.0), loss_db(5.0, other="c"), loss_db(5.0, seed=1)}) == 3


@pytest.mark.parametrize("shadowing_db", [0.0, 4.0])
def test_many_pairs_at_once_have_the_powers_of_each(shadowing_db):
    radio, names = RadioModel(shadowing_db=shadowing_db, seed=3), ("io", "europa", "titan")
    antennas = (ugv(0.0), ugv(30.0), UAV)
    powers = PairPowers(radio, names)
    a, b = np.array([0, 0, 1]), np.array([1, 2, 2])
    away_m = np.array([antennas[i].distance_m(antennas[j]) for i, j in zip(a, b, strict=True)])
    low = np.array([True, False, False])
    for time_s in (0.0, 4.0, 9.9, 10.0, 47.0):
        own = [
            radio.rssi_dbm(names[i], antennas[i], names[j], antennas[j], time_s)
            for i, j in zip(a, b, strict=True)
        ]
        assert powers.rssi_dbm(a, b, away_m, low, time_s).tolist() == own


def test_no_robot_hears_beyond_the_longest_range():
    radio = RadioModel(shadowing_db=2.0)
    reach_m = radio.longest_range_m(ground_to_ground=True)
    loudest = max(
        radio.rssi_dbm("a", ugv(0.0), "b", ugv(reach_m + 0.1), float(t)) for t in range(1000)
    )
    assert not radio.hears(loudest)
