"""Makes archived runs again from today's sources, and reports what comes out otherwise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from air_router.errors import EXPECTED
from mocha_link.errors import error_text
from sitl.experiment import Experiment, Record, Task, value_of
from sitl.experiment.campaign.running import make_run

_COSTS: Final = frozenset({"wall_s", "cpu_s", "speed_up"})
"""Columns that differ from one machine to the next."""

_ROUNDING: Final = 1e-9
"""Measures that differ by less, relatively, are equal: processors add in another order."""

_SIMULATED: Final = ("town", "mission")
"""Worlds in simulated time; flights in processes take the time that the machine takes."""


@dataclass(frozen=True, slots=True)
class Remade:
    """A run that was made again.

    Attributes:
        name: Which one.
        same: Whether all that it decided is as archived: the digest of its log.
        differing: Columns with other values; those that are new do not count.
        why: It could not be made again; empty: it was.
    """

    name: str
    same: bool
    differing: tuple[str, ...] = ()
    why: str = ""

    @property
    def text(self) -> str:
        """What came of it, in one line."""
        if self.why:
            return f"{self.name}: cannot be made again: {self.why}"
        if self.same and not self.differing:
            return f"{self.name}: the same"
        columns = ", ".join(self.differing[:5]) + (", ..." if len(self.differing) > 5 else "")
        return f"{self.name}: another digest; other {columns or 'texts, but the same columns'}"


def remakeable(experiment: Experiment, record: Record) -> bool:
    """Whether a run can be made again to the same digest on any machine."""
    world = value_of(record["settings"], "world")
    return world in _SIMULATED and record["row"] in {row.label for row in experiment.rows}


def remade(
    experiment: Experiment, record: Record, work: Callable[[Task], Record] = make_run
) -> Remade:
    """Make one archived run again.

    Args:
        experiment: As it was archived.
        record: One of its runs.
        work: Makes a run.
    """
    row = next(row for row in experiment.rows if row.label == record["row"])
    task = experiment.task(row, record["number"])
    name = f"{experiment.called(record['phase'])}, {task.name}"
    try:
        now = work(task)
    except EXPECTED as error:
        return Remade(name, same=False, why=error_text(error))
    before, after = record["measures"], now["measures"]
    differing = tuple(
        key
        for key, value in before.items()
        if key not in _COSTS and not (key in after and _equal(after[key], value))
    )
    return Remade(name, now["digest"] == record["digest"], differing)


def _equal(one: object, other: object) -> bool:
    """Whether two values of a measure are equal, but for the rounding of a processor."""
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=_ROUNDING)
    return one == other
