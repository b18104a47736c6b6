"""One run in simulated time: radio channel, events, results."""

from sitl.experiment.engine.channel import Link, Load, PaperChannel, Stage
from sitl.experiment.engine.engine import Run
from sitl.experiment.engine.exchange import (
    AirtimeStats,
    Transmission,
    needs_turn,
    stage_of,
)
from sitl.experiment.engine.flights import flown_here, flown_in_processes
from sitl.experiment.engine.result import BIN_S, airtime_measures, curves, measured, service_age_s

__all__ = [
    "BIN_S",
    "AirtimeStats",
    "Link",
    "Load",
    "PaperChannel",
    "Run",
    "Stage",
    "Transmission",
    "airtime_measures",
    "curves",
    "flown_here",
    "flown_in_processes",
    "measured",
    "needs_turn",
    "service_age_s",
    "stage_of",
]
