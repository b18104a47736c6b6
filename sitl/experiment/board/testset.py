"""The test set: scenarios and seeds that never change, and the rows of a policy on it."""

from __future__ import annotations

import hashlib
from typing import Any, Final

from air_router.errors import AirRouterError, ExitCode
from sitl.experiment import Experiment, Row, canonical, load_experiment

TEST_SET: Final = "testset1"
"""The experiment that holds it; another test set has another name."""

FINGERPRINT: Final = "f22f5e5b39c6"
"""Of its rows, the files that they name, and its seeds."""

NEVER: Final = "never"
"""In the place of a policy: the UAV never seeks a robot."""


class ChangedSetError(AirRouterError):
    """The test set is not the one that standings are of."""

    exit_code = ExitCode.INVALID_FILE


def frozen_set() -> Experiment:
    """The test set. Raises ChangedSetError: it has been changed."""
    experiment, path = load_experiment(TEST_SET)
    if (found := fingerprint(experiment)) != FINGERPRINT:
        raise ChangedSetError(
            f"{path} or a town that it names was changed ({found}, not {FINGERPRINT}); undo that, "
            "or make another test set with a name of its own"
        )
    return experiment


def fingerprint(experiment: Experiment) -> str:
    """Twelve hexadecimal digits that change with any scenario, file or seed."""
    numbers = range(experiment.first_seed, experiment.first_seed + experiment.seeds)
    runs: list[Any] = [[task.row.fingerprint, task.seed] for task in experiment.tasks(numbers)]
    return hashlib.sha256(canonical(runs).encode()).hexdigest()[:12]


def entries(experiment: Experiment, policies: tuple[str, ...]) -> Experiment:
    """The scenarios of a test set with each of these policies, on the same seeds."""
    rows = tuple(
        Row(f"{row.label}, {policy}", {**row.settings, **_chosen(policy)})
        for policy in policies
        for row in experiment.rows
    )
    return experiment.model_copy(update={"rows": rows})


def _chosen(policy: str) -> dict[str, Any]:
    return {"passive": True} if policy == NEVER else {"policy": policy}
