"""A bound on what any policy could bring about: how soon goals can be reached at best.

A relaxation. Robots know the whole town and all goals from the start, drive as fast on every ground
as on a road, and share the goals out as is best. A robot's first goal costs it its way there; each
further one at least the straight way from the nearest other goal. So a slot, the j-th goal of a
robot, has an earliest time for every goal, and the best assignment of slots to goals is the bound.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from geo.frame import Point
from geo.grid import Terrain
from mocha_link.errors import needs_extra
from sitl.world.explorers.explorer import NO_VEHICLE_M
from sitl.world.explorers.settings import ExplorerSettings
from sitl.world.towns.town import GRAIN_M, REACHED_M, Town
from sitl.world.towns.ways import PASSABLE, Ways


def goal_bound_share(
    town: Town, starts: Sequence[Point], explorer: ExplorerSettings, duration_s: float
) -> float:
    """At most this share of the goals is reached, in the mean over the run.

    Args:
        town: Where the goals are.
        starts: Where robots start.
        explorer: How fast they drive.
        duration_s: Of the run.
    """
    goals = [goal.position for goal in town.goals]
    if not goals or not starts:
        return 0.0
    reach_m = REACHED_M + NO_VEHICLE_M
    lattice = town.lattice
    ground = np.where(PASSABLE[town.ground], np.uint8(Terrain.ROAD), np.uint8(Terrain.BUILDING))
    near = [lattice.near(goal, reach_m) for goal in goals]
    first_m = np.array(
        [
            [min(costs[cells]) for cells in near]
            for costs in (Ways(lattice, ground, lattice.cell(start)).costs for start in starts)
        ]
    )
    first_m = np.maximum(first_m - GRAIN_M, 0.0)  # [robot, goal]
    hops_m = np.array(
        [
            max(min((math.dist(a, b) for b in goals if b != a), default=0.0) - 2 * reach_m, 0.0)
            for a in goals
        ]
    )
    before_m = np.concatenate(([0.0, 0.0], np.cumsum(np.sort(hops_m))))[: len(goals)]
    later_m = first_m.min(axis=1)[:, None, None] + before_m[:, None] + hops_m  # [robot, slot, goal]
    later_m[:, 0] = 0.0
    due_s = np.maximum(first_m[:, None], later_m) / (explorer.speed_m_s * explorer.progress)
    worth = np.maximum(1 - due_s / duration_s, 0.0).reshape(-1, len(goals))
    with needs_extra("an experiment", "experiments", "air-router"):
        from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - what takes its time
    return float(worth[linear_sum_assignment(worth, maximize=True)].sum()) / len(goals)
