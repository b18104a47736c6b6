"""No run can be better than the bound, and a plain town's is known."""

from pathlib import Path

import pytest

from geo.frame import Point
from sitl.experiment.engine.engine import goal_bound_share
from sitl.world.explorers.settings import ExplorerSettings
from sitl.world.towns.town_file import load_town

TOWN = """\
name: Street
frame: {origin: [38.5, -98.5]}
home: [0, 0]
bounds: {west_m: -100, south_m: -20, east_m: 100, north_m: 20}
outline: [[-98, -18], [98, -18], [98, 18], [-98, 18]]
roads:
  - {width_m: 8, points: [[-96, 0], [96, 0]]}
goals: {a: [53, 0], b: [-53, 0]}
starts: [[1, 1]]
"""
PACE = ExplorerSettings(speed_m_s=1.0, progress=1.0)
REACH_M = 13.0  # of arrival, and by which a vehicle may be taken for beside where it is


@pytest.fixture
def town(tmp_path: Path):
    path = tmp_path / "town.yaml"
    path.write_text(TOWN, encoding="utf-8")
    return load_town(path)


def test_robots_share_goals_and_one_alone_has_a_way_between_them(town):
    alone, both = [Point(1.0, 1.0)], [Point(1.0, 1.0), Point(-53.0, 1.0)]
    first_m = 53.0 - REACH_M - 2.0
    second_m = first_m + 106.0 - 2 * REACH_M
    share = (2 - (first_m + second_m) / 400.0) / 2
    assert goal_bound_share(town, alone, PACE, 400.0) == pytest.approx(share, abs=0.01)
    assert goal_bound_share(town, both, PACE, 400.0) == pytest.approx(
        (2 - first_m / 400.0) / 2, abs=0.01
    )
    assert goal_bound_share(town, alone, PACE, first_m + 20.0) == pytest.approx(
        20.0 / (first_m + 20.0) / 2, abs=0.03
    )
    assert goal_bound_share(town, [], PACE, 400.0) == 0.0
