"""What the paper reports of its simulated teams: plans/paper.csv.

F. Cladera et al., "Enabling Large-scale Heterogeneous Collaboration with Opportunistic
Communications", ICRA 2024, table I.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Final, NamedTuple


class PaperRow(NamedTuple):
    """One line of the paper's table."""

    radius_m: float
    uavs: float
    ugvs: float
    goals_percent: float
    mean_time_min: float
    wait_mean_s: float
    wait_sd_s: float


with Path(__file__).parents[1].joinpath("plans", "paper.csv").open(encoding="utf-8") as _file:
    TABLE: Final = tuple(PaperRow(*map(float, row)) for row in list(csv.reader(_file))[1:])


def paper_row(radius_m: float, uavs: int, ugvs: int) -> PaperRow | None:
    """The paper's line for a team; None if it has none."""
    return next((row for row in TABLE if row[:3] == (radius_m, uavs, ugvs)), None)
