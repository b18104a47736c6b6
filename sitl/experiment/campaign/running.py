"""Makes one run of an experiment and keeps what counts: what the workers do."""

from __future__ import annotations

import dataclasses
import platform
import resource
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from air_router.errors import AirRouterError, ExitCode
from air_router.files.settings import SeekPolicy
from sitl.experiment.campaign.runs import program
from sitl.experiment.engine.engine import Run, run
from sitl.experiment.engine.flights import flown_here, flown_in_processes
from sitl.experiment.engine.result import RunResult, curves, measured, seen_links
from sitl.experiment.plan import Record, Task
from sitl.experiment.plan_file import files_of, sources
from sitl.experiment.robots.scenery import scenery_of
from sitl.experiment.settings import (
    SIMULATION_TIMERS,
    ExplorerSettings,
    PaperModel,
    PathLossModel,
    RunSettings,
)

_PARTS: Final[Mapping[str, Any]] = {
    "paper": PaperModel(),
    "path_loss": PathLossModel(),
    "explorer": ExplorerSettings(),
    "timers": SIMULATION_TIMERS,
}
"""Settings with settings of their own; what a row does not say of them is as here."""


class OtherFilesError(AirRouterError):
    """This machine's town or mission is not the one of the experiment."""


class UnfitSettingsError(AirRouterError):
    """No run can be made of a row's settings."""

    exit_code = ExitCode.INVALID_FILE


def put_together(task: Task) -> None:
    """Make a run ready, and no more: what is wrong with a row shows before many are begun.

    Raises:
        AirRouterError, DocumentError: a file that the row names is not what it should be.
        UnfitSettingsError: settings that no run can be made of.
    """
    settings = run_settings(task)
    try:
        if settings.world == "town":
            Run(settings, task.seed)
        else:
            _mission_and_policy(settings)
    except ValueError as error:
        raise UnfitSettingsError(f"row '{task.row.label}': {error}") from None


def make_run(task: Task) -> Record:
    """One run of an experiment, as plain values.

    Raises:
        OtherFilesError: a file that the experiment names has another content on this machine.
    """
    settings = run_settings(task)
    if settings.world != "town":
        fly = flown_here if settings.world == "mission" else flown_in_processes
        mission, policy = _mission_and_policy(settings)
        flown = fly(mission, task.seed, policy)
        return _record(task, flown.measures, {}, flown.digest)
    return recorded(task, settings, run(settings, task.seed))


def _mission_and_policy(settings: RunSettings) -> tuple[Path, SeekPolicy]:
    """What is flown in a mission's own world. Raises ValueError."""
    if settings.mission is None or settings.policy == "oracle":
        raise ValueError("a world of its own needs a mission, and a policy that flies")
    return settings.mission, settings.policy


def run_settings(task: Task) -> RunSettings:
    """A task's plain settings as the engine takes them. Raises OtherFilesError."""
    values, folder = dict(task.row.settings), Path(task.folder)
    paths, here = files_of(values, folder), sources(values, folder)
    for key, expected in values.pop("sources").items():
        if here.get(key) != expected:
            raise OtherFilesError(
                f"{platform.node()}: {paths.get(key, key)} is not the file that the experiment "
                "began with; put the same file on every machine"
            )
    for key, usual in _PARTS.items():
        values[key] = dataclasses.replace(usual, **values.get(key, {}))
    values["values"] = tuple(values.get("values", ()))
    return RunSettings(**values | {"mission": None} | paths)


def recorded(task: Task, settings: RunSettings, result: RunResult) -> Record:
    """What is kept of a run; places only of each row's first."""
    kept = curves(result, settings.duration_s, places=task.number == 0)
    if settings.channel == "path_loss":
        kept["links"] = seen_links(result, scenery_of(settings).town.raster)
    return _record(task, measured(result, settings.duration_s), kept, result.digest)


def _record(
    task: Task, measures: Mapping[str, float | None], kept: Mapping[str, Any], digest: str
) -> Record:
    return {
        "experiment": task.experiment,
        "row": task.row.label,
        "number": task.number,
        "phase": task.phase,
        "rules": task.rules,
        "seed": task.seed,
        "fingerprint": task.row.fingerprint,
        "settings": dict(task.row.settings),
        "measures": measures,
        "curves": kept,
        "digest": digest,
        "program": program(),
        "machine": platform.node(),
        "peak_memory_MB": round(_peak_memory_mb()),
    }


def _peak_memory_mb() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak / 1e3
