"""What the paper reports of its simulated teams and of its days in the field.

F. Cladera et al., "Enabling Large-scale Heterogeneous Collaboration with Opportunistic
Communications", ICRA 2024, table I and section IV.
"""

from __future__ import annotations

from typing import Final, NamedTuple


class PaperRow(NamedTuple):
    """One line of the paper's table."""

    radius_m: float
    uavs: int
    ugvs: int
    goals_percent: float
    mean_time_min: float
    wait_mean_s: float
    wait_sd_s: float


TABLE: Final = tuple(
    PaperRow(*row)
    for row in (
        (5, 1, 3, 36.7, 23.0, 0.17, 0.87),
        (5, 1, 5, 70.0, 16.4, 0.18, 1.29),
        (5, 1, 10, 76.7, 15.8, 0.53, 5.13),
        (5, 2, 3, 40.0, 19.7, 0.23, 1.44),
        (5, 2, 5, 73.3, 18.6, 0.24, 2.42),
        (5, 2, 10, 70.0, 15.2, 0.63, 6.90),
        (10, 1, 3, 46.7, 16.5, 0.32, 1.80),
        (10, 1, 5, 55.6, 14.9, 0.40, 2.85),
        (10, 1, 10, 76.7, 14.0, 1.33, 13.89),
        (10, 2, 3, 53.3, 14.1, 0.61, 3.27),
        (10, 2, 5, 70.0, 13.8, 0.62, 4.93),
        (10, 2, 10, 73.3, 11.7, 1.11, 13.95),
        (20, 1, 3, 50.0, 14.6, 0.38, 2.66),
        (20, 1, 5, 55.6, 13.7, 0.49, 3.76),
        (20, 1, 10, 86.7, 14.0, 1.47, 25.73),
        (20, 2, 3, 43.3, 16.0, 1.05, 6.02),
        (20, 2, 5, 66.7, 12.1, 0.95, 8.43),
        (20, 2, 10, 75.6, 13.8, 3.91, 55.39),
        (30, 1, 3, 40.0, 16.1, 0.36, 2.62),
        (30, 1, 5, 66.7, 14.9, 0.95, 6.85),
        (30, 1, 10, 93.3, 13.9, 3.21, 35.45),
        (30, 2, 3, 60.0, 18.3, 1.20, 6.60),
        (30, 2, 5, 62.2, 12.0, 1.50, 12.08),
        (30, 2, 10, 73.3, 10.5, 6.80, 80.92),
    )
)

FIELD_INTERACTIONS: Final = 1720
FIELD_INTERRUPTED: Final = 7


def paper_row(radius_m: float, uavs: int, ugvs: int) -> PaperRow | None:
    """The paper's line for a team; None if it has none."""
    for row in TABLE:
        if (row.radius_m, row.uavs, row.ugvs) == (radius_m, uavs, ugvs):
            return row
    return None
