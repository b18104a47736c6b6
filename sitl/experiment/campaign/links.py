"""Can the semantic map tell which links will be there? What runs saw, and two predictions of it.

Each sample of a run is a case for every pair of robots on the ground: their distance, how many
metres of building lie between them, and whether they were in contact. A logistic regression
predicts the contact from the distance alone, another one from both; each learns from some runs and
is judged by the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from geo.grid import Terrain
from mocha_link.errors import needs_extra
from sitl.experiment.campaign.plan import Record
from sitl.experiment.engine.result import RunResult
from sitl.world.terrain import Raster

with needs_extra("an experiment", "experiments", "air-router"):
    from scipy.optimize import minimize
    from scipy.special import expit

Numbers = npt.NDArray[np.float64]

DISTANCES_M: Final = np.arange(0.0, 161.0, 4.0)
BUILDINGS_M: Final = np.array([0.0, 0.5, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 60.0])
_STEPS: Final = 80
"""A line between two robots is looked at in so many places: every two metres at the farthest."""


def seen_links(result: RunResult, raster: Raster) -> list[list[list[int]]]:
    """Cases of a run, counted: [distance][building] = [cases, in contact]."""
    ground = [i for i, kind in enumerate(result.kinds) if kind != "uav"]
    counts = np.zeros((len(DISTANCES_M) - 1, len(BUILDINGS_M) - 1, 2), dtype=np.int64)
    contacts = result.contacts
    for place, a in enumerate(ground):
        for b in ground[place + 1 :]:
            own = contacts[
                ((contacts["a"] == a) & (contacts["b"] == b))
                | ((contacts["a"] == b) & (contacts["b"] == a))
            ]
            times_s = result.sample_times_s[:, None]
            linked = ((own["began_s"] <= times_s) & (times_s < own["ended_s"])).any(axis=1)
            start, end = (result.positions_m[:, i].astype(np.float64) for i in (a, b))
            away_m = np.hypot(*(end - start).T)
            between_m = _building_m(start, end, away_m, raster)
            for column, chosen in ((0, np.ones_like(linked)), (1, linked)):
                found, _, _ = np.histogram2d(
                    away_m[chosen], between_m[chosen], bins=(DISTANCES_M, BUILDINGS_M)
                )
                counts[..., column] += found.astype(np.int64)
    plain: list[list[list[int]]] = counts.tolist()
    return plain


def _building_m(start: Numbers, end: Numbers, away_m: Numbers, raster: Raster) -> Numbers:
    """Metres of building between places."""
    along = ((np.arange(_STEPS) + 0.5) / _STEPS)[None, :, None]
    points = start[:, None] + along * (end - start)[:, None]
    hit = raster.classes_at(points[..., 0], points[..., 1]) == Terrain.BUILDING
    result: Numbers = hit.mean(axis=1) * away_m
    return result


@dataclass(frozen=True, slots=True)
class Prediction:
    """How well contacts are predicted.

    Attributes:
        brier: mean square of what was wrong, 0 to 1: less is better.
        area: chance that a pair in contact is held for likelier than one that is not (AUC).
    """

    brier: float
    area: float


def counts_of(records: Sequence[Record]) -> Numbers:
    """The cases of several runs together."""
    total: Numbers = np.array([r["curves"]["links"] for r in records], np.float64).sum(axis=0)
    return total


def judged(learn: Numbers, test: Numbers, *, buildings: bool) -> Prediction:
    """Learn from some cases, and judge by others."""
    weights = fitted(learn, buildings=buildings)
    chance = predicted(weights, buildings=buildings)
    cases, linked = test[..., 0], test[..., 1]
    wrong = linked * (1 - chance) ** 2 + (cases - linked) * chance**2
    return Prediction(float(wrong.sum() / cases.sum()), _area(chance, linked, cases - linked))


def fitted(counts: Numbers, *, buildings: bool) -> Numbers:
    """The weights of a logistic regression, with a whisper of a penalty."""
    features = _features(buildings=buildings)
    x = features.reshape(-1, features.shape[-1])
    cases, linked = counts[..., 0].ravel(), counts[..., 1].ravel()

    def loss(weights: Numbers) -> tuple[float, Numbers]:
        z = x @ weights
        value = (cases * np.logaddexp(0.0, z) - linked * z).sum() + 5e-4 * weights @ weights
        return float(value), x.T @ (cases * expit(z) - linked) + 1e-3 * weights

    weights: Numbers = minimize(loss, np.zeros(x.shape[1]), jac=True).x
    return weights


def predicted(weights: Numbers, *, buildings: bool) -> Numbers:
    """The chance of a contact: [distance][building]."""
    result: Numbers = expit(_features(buildings=buildings) @ weights)
    return result


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


def _area(chance: Numbers, yes: Numbers, no: Numbers) -> float:
    order = np.argsort(chance, axis=None)
    scores, y, n = (values.ravel()[order] for values in (chance, yes, no))
    _, group = np.unique(scores, return_inverse=True)
    yes_at, no_at = np.bincount(group, y), np.bincount(group, n)
    below = np.concatenate(([0.0], np.cumsum(no_at)[:-1]))
    total = float(yes_at.sum() * no_at.sum())
    return float((yes_at * (below + no_at / 2)).sum()) / total if total else float("nan")


def halves(records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """Runs to learn from, and runs to be judged by."""
    even = [record for record in records if record["number"] % 2 == 0]
    odd = [record for record in records if record["number"] % 2]
    return even, odd


def comparison(records: Sequence[Record]) -> dict[str, Any]:
    """Both predictions, learned from one half of the runs and judged by the other."""
    learn, test = (counts_of(half) for half in halves(records))
    return {
        name: judged(learn, test, buildings=flag)
        for name, flag in (("distance", False), ("distance and map", True))
    }
