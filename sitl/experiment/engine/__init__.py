"""One run in simulated time: radio channel, events, results."""

from sitl.experiment.engine.engine import Run
from sitl.experiment.engine.flights import flown_here, flown_in_processes
from sitl.experiment.engine.result import BIN_S, curves, measured, service_age_s

__all__ = [
    "BIN_S",
    "Run",
    "curves",
    "flown_here",
    "flown_in_processes",
    "measured",
    "service_age_s",
]
