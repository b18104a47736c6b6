"""The statistics of `sitl.world.measured_link`, from the measurements that it names.

    python -m benchmarks.measured_link FOLDER      # data_gen/raw_data of their publication

Power is averaged over each second of level flight (within 5 m of the most frequent height), and
compared with free space. Bands of elevation have the mean and the standard deviation of all
flights. Deviations, in units of their band's, of two moments of a flight that are less than a
minute apart give the correlation by the UAV's way.
"""

from __future__ import annotations

import itertools
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.io import loadmat

Numbers = npt.NDArray[np.float64]

# Latitude and longitude in degrees of the three places of the robot, by number.
PLACES: Final = {
    1: (35.72806709, -78.69730398),
    2: (35.72911779, -78.69918128),
    3: (35.72985129, -78.69711002),
}
ANTENNA_M: Final = 1.5
BANDS_DEG: Final = (0, 5, 10, 15, 20, 30, 45, 60, 75, 90)
_EARTH_M: Final = 6_378_137.0
_NAME: Final = re.compile(r"results_useful_ori_exp_(\d+)_loc_(\d)\.mat")
_STEP_M: Final = 5.0
_LAGS: Final = range(1, 60)


class Flight(NamedTuple):
    """Level flight, by seconds."""

    east_m: Numbers
    north_m: Numbers
    elevation_deg: Numbers
    over_free_space_db: Numbers  # but for a constant, as the powers are not calibrated


class Band(NamedTuple):
    """What was measured between two elevations."""

    elevation_deg: float
    mean_db: float
    deviation_db: float
    seconds: int


def flights(folder: Path) -> Iterator[Flight]:
    """All flights of a folder."""
    for path in sorted(folder.iterdir()):
        if found := _NAME.fullmatch(path.name):
            yield flight(loadmat(path), PLACES[int(found[2])])


def flight(columns: dict[str, Any], place: tuple[float, float]) -> Flight:
    """One flight from the columns of its file."""
    names = ("mY", "mX", "mZ", "mpower", "timestamp_power")
    latitude, longitude, up_m, power_db, time_s = (np.ravel(columns[name]) for name in names)
    usual_m = np.bincount(np.clip(np.round(up_m), 0, None).astype(int)).argmax()
    level = np.abs(up_m - usual_m) < 5
    second = np.floor(time_s[level] - time_s[level][0]).astype(int)
    _, second = np.unique(second, return_inverse=True)
    counts = np.bincount(second)

    def mean(values: Numbers) -> Numbers:
        means: Numbers = np.bincount(second, values[level]) / counts
        return means

    north_m = mean(np.radians(latitude - place[0]) * _EARTH_M)
    east_m = mean(np.radians(longitude - place[1]) * _EARTH_M * np.cos(np.radians(place[0])))
    high_m, flat_m = mean(up_m) - ANTENNA_M, np.hypot(east_m, north_m)
    level_db = 10 * np.log10(mean(10 ** (power_db / 10)))
    over_db = level_db + 20 * np.log10(np.hypot(flat_m, high_m))
    return Flight(east_m, north_m, np.degrees(np.arctan2(high_m, flat_m)), over_db)


def bands(flown: list[Flight]) -> list[Band]:
    """The statistics by elevation of all flights."""
    elevation = np.concatenate([each.elevation_deg for each in flown])
    over_db = np.concatenate([each.over_free_space_db for each in flown])
    found = []
    for low, high in itertools.pairwise(BANDS_DEG):
        own = (elevation >= low) & (elevation < high)
        if own.any():
            values = over_db[own]
            means = float(elevation[own].mean()), float(values.mean()), float(values.std())
            found.append(Band(*means, int(own.sum())))
    return found


def correlations(flown: list[Flight], by: list[Band]) -> dict[float, float]:
    """The correlation of deviations by how far the UAV has come, in m."""
    at, mean_db, deviation_db, _ = map(np.array, zip(*by, strict=True))
    sums: dict[float, float] = {}
    counts: dict[float, int] = {}
    for each in flown:
        expected_db = np.interp(each.elevation_deg, at, mean_db)
        own = each.over_free_space_db - expected_db
        own /= np.interp(each.elevation_deg, at, deviation_db)
        for lag in _LAGS:
            way_m = np.hypot(
                each.east_m[lag:] - each.east_m[:-lag], each.north_m[lag:] - each.north_m[:-lag]
            )
            product = own[lag:] * own[:-lag]
            for step in range(16):
                near = (way_m // _STEP_M).astype(int) == step
                middle_m = (step + 0.5) * _STEP_M
                sums[middle_m] = sums.get(middle_m, 0.0) + float(product[near].sum())
                counts[middle_m] = counts.get(middle_m, 0) + int(near.sum())
    return {way_m: sums[way_m] / counts[way_m] for way_m in sorted(sums) if counts[way_m]}


def main() -> int:
    """Print the statistics of a folder."""
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    flown = list(flights(Path(sys.argv[1])))
    if not flown:
        print(f"no flight in {sys.argv[1]}", file=sys.stderr)
        return 1
    found = bands(flown)
    best_db = max(band.mean_db for band in found)
    print(f"{len(flown)} flights, {sum(band.seconds for band in found)} s")
    print("elevation  excess  deviation  seconds")
    for band in found:
        excess_db = best_db - band.mean_db
        values_db = f"{excess_db:6.1f}  {band.deviation_db:9.1f}"
        print(f"{band.elevation_deg:9.1f}  {values_db}  {band.seconds:7}")
    print("way, m  correlation")
    for way_m, value in correlations(flown, found).items():
        print(f"{way_m:6.1f}  {value:11.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
