"""Makes one run of an experiment and keeps what counts: what the workers do."""

from __future__ import annotations

import platform
import resource
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from air_router.errors import AirRouterError, ExitCode
from air_router.files.settings import SeekPolicy, Timers
from sitl.experiment.campaign.links import seen_links
from sitl.experiment.campaign.plan import Record, Task
from sitl.experiment.campaign.plan_file import content_hash, files_of
from sitl.experiment.campaign.run_log import program
from sitl.experiment.engine.engine import Run, run
from sitl.experiment.engine.flights import flown_here, flown_in_processes
from sitl.experiment.engine.result import RunResult, curves, measured
from sitl.experiment.robots.scenery import scenery_of
from sitl.experiment.settings import (
    ExplorerSettings,
    PaperModel,
    PathLossModel,
    RunSettings,
    TraceModel,
)

_PARTS: Final[dict[str, Callable[..., Any]]] = {
    "paper": PaperModel,
    "path_loss": PathLossModel,
    "explorer": ExplorerSettings,
}


class OtherFilesError(AirRouterError):
    """This machine's town, mission or trace is not the one of the experiment."""


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
    values = dict(task.row.settings)
    folder = Path(task.folder)
    paths = files_of(values, folder)
    trace = values.pop("trace", None)
    values.pop("mission", None)
    del values["town"]
    for key, expected in values.pop("sources").items():
        if key not in paths or content_hash(paths[key]) != expected:
            raise OtherFilesError(
                f"{platform.node()}: {paths.get(key, key)} is not the file that the experiment "
                "began with; put the same file on every machine"
            )
    parts = {key: make(**values.pop(key, {})) for key, make in _PARTS.items()}
    if trace is not None:
        parts["trace"] = TraceModel(**{**trace, "path": paths["trace"]})
    for key in {"base_goals", "values"} & values.keys():
        values[key] = tuple(values[key])
    if "timers" in values:
        values["timers"] = Timers(**{**_timers(), **values["timers"]})
    return RunSettings(town=paths["town"], mission=paths.get("mission"), **parts, **values)


def _timers() -> dict[str, float]:
    timers = RunSettings.__dataclass_fields__["timers"].default
    return {name: getattr(timers, name) for name in Timers.__dataclass_fields__}


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
