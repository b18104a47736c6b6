"""The groups of figures, each measured by the module of its name."""

import importlib
import traceback

from benchmarks.goals.figure import Conditions, Figure, UnmeasuredError

GROUPS = (
    *("contacts", "neighbourhoods", "links", "floods", "syncs", "databases"),
    *("routes", "flight_loop", "searches", "reaction", "editing", "live_page"),
)


def figures_of(name: str, conditions: Conditions) -> tuple[list[Figure], str]:
    """All figures of a group, and why there are no more of them; "": that is all."""
    figures: list[Figure] = []
    try:
        for figure in importlib.import_module(f"benchmarks.goals.{name}").measure(conditions):
            figures.append(figure)  # noqa: PERF402 - those before a failure stay
    except UnmeasuredError as error:
        return figures, str(error)
    except Exception:  # noqa: BLE001 - the other groups do not suffer by it
        return figures, traceback.format_exc()
    return figures, ""
