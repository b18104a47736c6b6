"""How probable it is that a robot's radio is received: a regression, fitted anew in flight.

    logit(probability) = weights . features

The features follow from where both are and, for the `SEMANTIC` model, from what the vehicle has
mapped along the line between them: metres of building and of vegetation in two layers of height,
since maps have no heights. Weights are those that are most probable by the measured
links of this flight and a prior, in which obstacles and distance weaken a link, with little
certainty of how much. So the model is of use before the first measurement, and calibrated by what
is measured.

Successive samples of one robot are strongly correlated: each has the weight
`SAMPLE_WEIGHT`, so that the model is not surer than it may be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from air_router.link_model.limits import (
    BUILDING_M,
    LAYERS_M,
    LEAST_UP_M,
    MOST_STEPS,
    SAMPLE_WEIGHT,
    STEPS,
    VEGETATION_M,
)
from air_router.seek_policies import LinkSample
from geo.grid import SemanticGrid, Terrain

Numbers = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ModelKind:
    """Which features a model has, and what is believed of their weights beforehand.

    Attributes:
        name: Of the model.
        log_distance: It has the logarithm of the distance; otherwise the distance.
        semantic: It has what is mapped along the line.
        mean: Of the weights' priors.
        deviation: Of these.
    """

    name: str
    log_distance: bool
    semantic: bool
    mean: tuple[float, ...]
    deviation: tuple[float, ...]


DISTANCE: Final = ModelKind("distance", False, False, (4.0, -3.0), (4.0, 3.0))
"""Falls with the distance, per 100 m."""

PATH_LOSS: Final = ModelKind("path loss", True, False, (1.0, -9.0), (4.0, 5.0))
"""Falls with the logarithm of the distance, as power does: 9 for each factor of 10 is a path loss
exponent of 2 with shadowing of 4 dB."""

SEMANTIC: Final = ModelKind(
    *("semantic map", True, True),
    (1.0, -9.0, -4.0, -2.0, -2.0, -1.0),
    (4.0, 5.0, 3.0, 2.0, 2.0, 2.0),
)
"""The same, and what is mapped along the line: buildings in the lower and the upper layer, then
vegetation."""

MODELS: Final = (DISTANCE, PATH_LOSS, SEMANTIC)


@dataclass(frozen=True, slots=True, eq=False)
class LinkModel:
    """A fitted model.

    Attributes:
        kind: Which features it has.
        weights: Of the features.
        ground: What is mapped, as it was when the model was fitted or has grown since.
    """

    kind: ModelKind
    weights: Numbers
    ground: SemanticGrid | None

    def probability(self, air: Numbers, ground: Numbers) -> Numbers:
        """How probable links are, between 0 and 1.

        Args:
            air: (n, 3): where the vehicle is or would be; east, north and height in metres.
            ground: (n, 2): where the robot is.
        """
        return _logistic(features(self.kind, self.ground, air, ground) @ self.weights)


def fitted(
    kind: ModelKind, samples: Sequence[LinkSample], ground: SemanticGrid | None
) -> LinkModel:
    """A model fitted to the measured links of a flight; without any its prior.

    Args:
        kind: Which.
        samples: The measured links.
        ground: What the vehicle has mapped; None: nothing.
    """
    mean, precision = np.array(kind.mean), np.array(kind.deviation) ** -2.0
    if not samples:
        return LinkModel(kind, mean, ground)
    air = np.array([(*sample.here, sample.altitude_m) for sample in samples])
    places = np.array([sample.place for sample in samples])
    linked = np.array([sample.linked for sample in samples], dtype=np.float64)
    rows = features(kind, ground, air, places)
    return LinkModel(kind, _most_probable(rows, linked, mean, precision), ground)


def _most_probable(rows: Numbers, linked: Numbers, mean: Numbers, precision: Numbers) -> Numbers:
    """The weights, by Newton's method with steps halved until they help."""

    def cost(weights: Numbers) -> float:
        logits = rows @ weights
        fit = SAMPLE_WEIGHT * float((np.logaddexp(0.0, logits) - linked * logits).sum())
        return fit + 0.5 * float((precision * (weights - mean) ** 2).sum())

    weights = mean.copy()
    for _ in range(MOST_STEPS):
        expected = _logistic(rows @ weights)
        slope = SAMPLE_WEIGHT * rows.T @ (expected - linked) + precision * (weights - mean)
        bend = SAMPLE_WEIGHT * (rows.T * (expected * (1 - expected))) @ rows + np.diag(precision)
        step, before = np.linalg.solve(bend, slope), cost(weights)
        while cost(weights - step) > before and np.abs(step).max() > 1e-6:
            step /= 2
        weights = weights - step
        if np.abs(step).max() < 1e-4:
            break
    return np.round(weights, 6)  # alike on machines that round otherwise in the last digits


def features(
    kind: ModelKind, ground: SemanticGrid | None, air: Numbers, places: Numbers
) -> Numbers:
    """(n, features) of links between places in the air (n, 3) and on the ground (n, 2)."""
    away = air[:, :2] - places
    up_m = np.maximum(air[:, 2], LEAST_UP_M)
    away_m = np.sqrt((away**2).sum(axis=1) + up_m**2)
    distance = np.log10(away_m / 100) if kind.log_distance else away_m / 100
    columns = [np.ones(len(air)), distance]
    if kind.semantic:
        scales_m = {Terrain.BUILDING: BUILDING_M, Terrain.VEGETATION: VEGETATION_M}
        for terrain, scale_m in scales_m.items():
            columns += [
                1 - np.exp(-crossed_m(ground, terrain, places, away, up_m, layer_m) / scale_m)
                for layer_m in LAYERS_M
            ]
    return np.stack(columns, axis=1)


def crossed_m(  # noqa: PLR0913, PLR0917 - lines, and what of them counts
    ground: SemanticGrid | None,
    terrain: Terrain,
    places: Numbers,
    away: Numbers,
    up_m: Numbers,
    layer_m: tuple[float, float],
) -> Numbers:
    """Metres of lines that are over a class, where they are between two heights.

    What is not mapped counts by the share that the class has of what is.

    Args:
        ground: The map; None: nothing of the class is anywhere.
        terrain: The class.
        places: (n, 2): the lines' lower ends.
        away: (n, 2): from there to below their upper ends.
        up_m: (n): how high these are.
        layer_m: The heights.
    """
    if ground is None:
        return np.zeros(len(places))
    low_m, high_m = layer_m
    heights_m = low_m + (np.arange(STEPS) + 0.5) * (high_m - low_m) / STEPS
    share = heights_m / up_m[:, None]
    east = (places[:, :1] + share * away[:, :1] - ground.west_m) / ground.resolution_m
    north = (places[:, 1:] + share * away[:, 1:] - ground.south_m) / ground.resolution_m
    column, row = np.floor(east).astype(np.intp), np.floor(north).astype(np.intp)
    rows, columns = ground.cells.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns) & (share <= 1)
    cells = ground.cells[row.clip(0, rows - 1), column.clip(0, columns - 1)]
    known = np.count_nonzero(ground.cells)
    usual = np.count_nonzero(ground.cells == terrain) / known if known else 0.0
    hit = np.where(cells == Terrain.UNKNOWN, usual, cells == terrain) * inside
    line_m = np.sqrt((away**2).sum(axis=1) + up_m**2)
    found: Numbers = hit.mean(axis=1) * line_m * (high_m - low_m) / up_m
    return found


def _logistic(logits: Numbers) -> Numbers:
    found: Numbers = 0.5 * (1 + np.tanh(0.5 * logits))
    return found
