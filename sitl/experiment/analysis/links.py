"""Can the semantic map tell which links will be there? Two predictions of what runs saw.

`engine.result.seen_links` counts the cases of a run. A logistic regression predicts the contact of
two robots from their distance alone, another one from the metres of building between them, too;
each learns from some runs and is judged by the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mocha_link.errors import needs_extra
from sitl.experiment.engine.result import BUILDINGS_M, DISTANCES_M
from sitl.experiment.plan import Record

with needs_extra("an experiment", "experiments", "air-router"):
    from scipy.optimize import minimize
    from scipy.special import expit

Numbers = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """How well contacts are predicted.

    Attributes:
        chance: of a contact: [distance][building], in the bins of `engine.result`.
        brier: mean square of what was wrong, 0 to 1: less is better.
        area: chance that a pair in contact is held for likelier than one that is not (AUC).
    """

    chance: Numbers
    brier: float
    area: float


def halves(records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """Runs to learn from, and runs to be judged by."""
    even = [record for record in records if record["number"] % 2 == 0]
    odd = [record for record in records if record["number"] % 2]
    return even, odd


def comparison(records: Sequence[Record]) -> dict[str, Prediction]:
    """Both predictions, learned from one half of the runs and judged by the other."""
    learn, test = (counts_of(half) for half in halves(records))
    return {
        name: judged(learn, test, buildings=flag)
        for name, flag in (("distance", False), ("distance and map", True))
    }


def counts_of(records: Sequence[Record]) -> Numbers:
    """The cases of several runs together."""
    total: Numbers = np.array([r["curves"]["links"] for r in records], np.float64).sum(axis=0)
    return total


def judged(learn: Numbers, test: Numbers, *, buildings: bool) -> Prediction:
    """Learn from some cases, and judge by others."""
    features = _features(buildings=buildings)
    chance: Numbers = expit(features @ _weights(features, learn))
    cases, linked = test[..., 0], test[..., 1]
    wrong = linked * (1 - chance) ** 2 + (cases - linked) * chance**2
    area = _area(chance, linked, cases - linked)
    return Prediction(chance, float(wrong.sum() / cases.sum()), area)


def _features(*, buildings: bool) -> Numbers:
    """What a prediction sees of a case: log distance, and metres of building."""
    distance = (DISTANCES_M[:-1] + DISTANCES_M[1:])[:, None] / 2
    between = (BUILDINGS_M[:-1] + BUILDINGS_M[1:])[None, :] / 2
    between = np.where(BUILDINGS_M[None, :-1] == 0, 0.0, between)
    ones = np.ones((distance.shape[0], between.shape[1]))
    columns = [ones, np.log10(distance) * ones]
    if buildings:
        columns += [np.minimum(between, 30.0) / 10 * ones, (between > 0) * ones]
    return np.stack(columns, axis=-1)


def _weights(features: Numbers, counts: Numbers) -> Numbers:
    """The weights of a logistic regression, with a whisper of a penalty."""
    x = features.reshape(-1, features.shape[-1])
    cases, linked = counts[..., 0].ravel(), counts[..., 1].ravel()

    def loss(weights: Numbers) -> tuple[float, Numbers]:
        z = x @ weights
        value = (cases * np.logaddexp(0.0, z) - linked * z).sum() + 5e-4 * weights @ weights
        return float(value), x.T @ (cases * expit(z) - linked) + 1e-3 * weights

    weights: Numbers = minimize(loss, np.zeros(x.shape[1]), jac=True).x
    return weights


def _area(chance: Numbers, yes: Numbers, no: Numbers) -> float:
    """The chance that one of `yes` has a larger `chance` than one of `no`; ties count half."""
    scores, group = np.unique(chance, return_inverse=True)
    yes_at, no_at = (np.bincount(group.ravel(), own.ravel(), len(scores)) for own in (yes, no))
    below = np.cumsum(no_at) - no_at
    total = float(yes_at.sum() * no_at.sum())
    return float((yes_at * (below + no_at / 2)).sum()) / total if total else float("nan")
