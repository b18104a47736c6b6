"""Makes one run of an experiment and keeps what counts: what the workers do."""

from __future__ import annotations

import platform
import resource
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from air_router.errors import AirRouterError, ExitCode
from air_router.seek_policies import policy_of
from sitl.experiment import OFF_BOARD, Record, RunSettings, Task, files_of, sources
from sitl.experiment.campaign.journal import stamp, utc_now
from sitl.experiment.campaign.provenance import commit, dependencies, program
from sitl.experiment.engine import Run, curves, flown_here, flown_in_processes, measured


class OtherFilesError(AirRouterError):
    """A town or mission is not the one of the experiment any more."""


class UnfitSettingsError(AirRouterError):
    """No run can be made of a row's settings."""

    exit_code = ExitCode.INVALID_FILE


def put_together(task: Task) -> None:
    """Make a run ready, and no more: what is wrong with a row shows before many are begun.

    Raises:
        AirRouterError, DocumentError: a file that the row names is not what it should be.
        UnfitSettingsError: settings that no run can be made of.
    """
    settings = settings_of(task)
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
        OtherFilesError: a file that the experiment names has another content by now.
    """
    settings = settings_of(task)
    if settings.world == "town":
        run = Run(settings, task.seed)
        run.finish()
        return recorded(task, run)
    mission, policy = _mission_and_policy(settings)
    if settings.world == "mission":
        flown = flown_here(mission, task.seed, policy)
    else:
        px4 = settings.world == "px4"
        flown = flown_in_processes(mission, task.seed, policy, px4=px4)
    return _record(task, flown.measures, {}, flown.digest, flown.faults)


def _mission_and_policy(settings: RunSettings) -> tuple[Path, str]:
    """What is flown in a mission's own world. Raises ValueError, SeekPolicyError."""
    mission, policy = settings.mission, settings.policy
    if mission is None or policy in OFF_BOARD:
        raise ValueError("a world of its own needs a mission, and a policy that flies")
    policy_of(policy)
    return mission, policy


def settings_of(task: Task) -> RunSettings:
    """A task's plain settings as the engine takes them. Raises OtherFilesError."""
    values, folder = dict(task.row.settings), Path(task.folder)
    paths, here = files_of(values, folder), sources(values, folder)
    for key, expected in values.pop("sources").items():
        if here.get(key) != expected:
            raise OtherFilesError(
                f"{paths.get(key, key)} is not the file any more that the experiment began with; "
                "begin it again"
            )
    return RunSettings.model_validate({**values, "mission": None, **paths})


def recorded(task: Task, run: Run) -> Record:
    """What is kept of a run that is over."""
    return _record(task, measured(run), curves(run), run.log.digest, run.faults)


def _record(
    task: Task,
    measures: Mapping[str, float | None],
    kept: Mapping[str, Any],
    digest: str,
    faults: Mapping[str, str],
) -> Record:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        **task.identity,
        "rules": task.rules,
        "declaration": task.declaration,
        "settings": dict(task.row.settings),
        "measures": measures,
        "curves": kept,
        "digest": digest,
        "faults": dict(faults),
        "program": program(),
        "commit": commit(),
        "dependencies": dict(dependencies()),
        "machine": platform.node(),
        "ended": stamp(utc_now()),
        "peak_memory_MB": round(peak / (1e6 if sys.platform == "darwin" else 1e3)),
    }
