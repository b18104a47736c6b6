"""Experiments: towns full of robots in simulated time, thousands of times faster than real."""

from sitl.experiment.events import EventLog, EventQueue
from sitl.experiment.plan import (
    ClaimRule,
    Experiment,
    PartRule,
    Phase,
    Record,
    Row,
    Task,
    canonical,
    flat,
    rows_with,
    said,
    seeds_of,
    words,
)
from sitl.experiment.plan_file import (
    experiment_names,
    experiment_of,
    files_of,
    load_experiment,
    sources,
)
from sitl.experiment.settings import (
    Between,
    MessageWait,
    PaperModel,
    PathLossModel,
    RunSettings,
    draw,
    value_of,
)

__all__ = [
    "Between",
    "ClaimRule",
    "EventLog",
    "EventQueue",
    "Experiment",
    "MessageWait",
    "PaperModel",
    "PartRule",
    "PathLossModel",
    "Phase",
    "Record",
    "Row",
    "RunSettings",
    "Task",
    "canonical",
    "draw",
    "experiment_names",
    "experiment_of",
    "files_of",
    "flat",
    "load_experiment",
    "rows_with",
    "said",
    "seeds_of",
    "sources",
    "value_of",
    "words",
]
