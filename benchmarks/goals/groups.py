"""The groups of figures, each measured by the module of its name."""

import importlib
import traceback

from benchmarks.goals.figure import Conditions, Figure, UnmeasuredError

GROUPS = (
    *("contacts", "neighbourhoods", "links", "floods"),
    *("routes", "flight_loop", "editing"),
)


def figures_of(name: str, conditions: Conditions) -> list[Figure]:
    """All figures of a group.

    Raises:
        UnmeasuredError: it cannot be measured, or failed; the other groups do not suffer by it.
    """
    try:
        return [*importlib.import_module(f"benchmarks.goals.{name}").measure(conditions)]
    except UnmeasuredError:
        raise
    except Exception as error:
        raise UnmeasuredError(traceback.format_exc()) from error
