"""The link that AERPAW measured: its values, how it varies, and how its numbers are computed."""

import numpy as np
import pytest
from scipy.io import savemat

from benchmarks.measured_link import PLACES, bands, correlations, flights
from sitl.world import AirToGround, MeasuredLink, air_loss
from sitl.world.air_to_ground import free_space_db
from sitl.world.measured_link import FADING_M

GROUND = np.array([(0.0, 0.0, 0.5)])
AWAY_M = 100.0


def beyond_free_space_db(elevation_deg, seed=1, away_m=AWAY_M, ghz=2.4):
    elevation = np.radians(elevation_deg)
    air = GROUND + away_m * np.array([(np.cos(elevation), 0.0, np.sin(elevation))])
    lost_db = MeasuredLink(ghz, seed).loss_db(air, GROUND)[0, 0]
    return float(lost_db - free_space_db(np.array(away_m), ghz))


@pytest.fixture(scope="module")
def drawn():
    """By elevation: losses of many seeds."""
    elevations = (2.0, 7.6, 12.2, 37.4, 65.8, 90.0)
    return {e: [beyond_free_space_db(e, seed) for seed in range(400)] for e in elevations}


@pytest.mark.parametrize(
    ("elevation_deg", "mean_db", "deviation_db"),
    [
        (2.0, 29.4, 16.8),  # as at the lowest that was measured
        (7.6, 24.6, 14.9),
        (12.2, 18.6, 13.9),
        (37.4, 2.0, 7.6),
        (65.8, 10.6, 8.3),
        (90.0, 20.3, 10.2),
    ],
)
def test_losses_beyond_free_space_are_those_of_the_measurements(
    drawn, elevation_deg, mean_db, deviation_db
):
    values = drawn[elevation_deg]
    assert np.mean(values) == pytest.approx(mean_db, abs=2.5)
    assert np.std(values) == pytest.approx(deviation_db, rel=0.15)
    assert max(np.abs(np.subtract(values, mean_db))) <= 3 * deviation_db + 1e-9


def test_a_carrier_changes_free_space_only():
    assert beyond_free_space_db(30.0, ghz=2.4) == pytest.approx(beyond_free_space_db(30.0, ghz=5.8))


def test_a_link_is_of_its_places_and_seed_and_changes_over_tens_of_metres():
    link = MeasuredLink(2.4, 5)
    air = np.array([(60.0 + step, 0.0, 45.0) for step in (0.0, 1.0, 10 * FADING_M)])
    first = link.loss_db(air, GROUND)
    assert np.array_equal(first, MeasuredLink(2.4, 5).loss_db(air, GROUND))
    assert not np.array_equal(first, MeasuredLink(2.4, 6).loss_db(air, GROUND))
    assert abs(first[0, 0] - first[1, 0]) < 4.0


def test_models_of_links_are_known_by_their_names():
    assert isinstance(air_loss("aerpaw", 2.4, 0), MeasuredLink)
    assert isinstance(air_loss("umi_av", 2.4, 0), AirToGround)


def test_the_statistics_are_those_of_the_flights(tmp_path):
    """A flight over a made-up land: 20 dB of loss below 15 degrees, none above; then no file."""
    latitude, longitude = PLACES[2]
    time_s = np.arange(0, 600, 0.1)
    north_m = np.linspace(20, 400, len(time_s))
    up_m = np.where(time_s < 10, 5.0, 40.0)  # the climb does not count
    away_m = np.hypot(north_m, up_m - 1.5)
    low = np.degrees(np.arctan2(up_m - 1.5, north_m)) < 15
    power_db = 50 - 20 * np.log10(away_m) - 20.0 * low
    columns = {
        "mY": latitude + np.degrees(north_m / 6_378_137.0),
        "mX": np.full(len(time_s), longitude),
        "mZ": up_m,
        "mpower": np.where(time_s < 10, -90.0, power_db),
        "timestamp_power": 1.7e9 + time_s,
    }
    savemat(tmp_path / "results_useful_ori_exp_288_loc_2.mat", columns)
    (tmp_path / "README").write_text("no flight")
    flown = list(flights(tmp_path))
    found = bands(flown)
    assert sum(band.seconds for band in found) == 590
    for band in found:
        assert band.mean_db == pytest.approx(30.0 if band.elevation_deg < 15 else 50.0, abs=0.5)
        assert band.deviation_db < 2.0
    assert set(correlations(flown, found)) >= {2.5, 7.5}
