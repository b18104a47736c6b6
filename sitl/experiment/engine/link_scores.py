"""How well models of links predict the links that follow, while a run goes on.

Models are fitted anew every `FIT_S` to what the UAV's controller has measured by then, and are not
touched until the next time. In between, all pairs of a UAV in the air and a ground robot are
predicted every `SCORE_S`, from where both truly are, and compared with what the channel then does.
So every link that is scored is one that the model has not seen, and robots that the UAV knows
nothing of count, too. The least that a model has to beat is a constant: the share of the measured
links that were there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from air_router.link_model import MODELS, SEMANTIC, LinkModel, fitted
from sitl.experiment.robots import Uav

FIT_S: Final = 120.0
SCORE_S: Final = 5.0

BINS: Final = 10
"""Of predicted probabilities, for calibration curves."""

_SURE: Final = 1e-3  # no prediction is surer, so that no logarithm is infinite

Numbers = npt.NDArray[np.float64]

CONSTANT: Final = "constant"


class LinkScores:
    """Fits and scores models of links.

    Args:
        in_contact: Whether two robots, by their numbers, are in contact now.
    """

    def __init__(self, in_contact: Callable[[int, int], bool]) -> None:
        self._in_contact = in_contact
        self._fit_s = FIT_S  # of the next fit
        self._score_s = FIT_S  # of the next predictions
        self._models: dict[int, list[LinkModel]] = {}  # by the UAV's number
        self._constants: dict[int, float] = {}  # likewise
        names = (CONSTANT, *(kind.name for kind in MODELS))
        self._predicted: dict[str, list[float]] = {name: [] for name in names}
        self._linked: list[bool] = []  # what came of these predictions

    def update(
        self, now_s: float, uavs: Mapping[int, Uav], robots: Mapping[str, int], places: Numbers
    ) -> None:
        """Robots have moved.

        Args:
            now_s: Simulated time.
            uavs: Those in the air, by their numbers.
            robots: Numbers of the ground robots.
            places: East, north and height above ground of all robots, by number.
        """
        if now_s >= self._fit_s:
            self._fit_s += FIT_S
            for number, uav in uavs.items():
                links, ground = uav.links, uav.painter.grid
                self._models[number] = [fitted(kind, links, ground) for kind in MODELS]
                linked = sum(sample.linked for sample in links)
                self._constants[number] = (linked + 0.5) / (len(links) + 1.0)
        if now_s < self._score_s or not robots:
            return
        self._score_s = now_s + SCORE_S
        numbers = list(robots.values())
        for number in uavs.keys() & self._models.keys():
            air = np.broadcast_to(places[number], (len(numbers), 3))
            for model in self._models[number]:
                found = model.probability(air, places[numbers, :2])
                self._predicted[model.kind.name] += found.tolist()
            self._predicted[CONSTANT] += [self._constants[number]] * len(numbers)
            self._linked += [self._in_contact(number, robot) for robot in numbers]

    def measures(self) -> dict[str, float | int | None]:
        """Columns of a run: Brier score and log loss of each model, and what the map gains.

        None: nothing was scored.
        """
        linked = np.array(self._linked, dtype=np.float64)
        some = bool(self._linked)
        found: dict[str, float | int | None] = {
            "links_scored": len(linked),
            "linked_percent": 100 * float(linked.mean()) if some else None,
        }
        for name, values in self._predicted.items():
            key, p = name.replace(" ", "_"), np.clip(np.array(values), _SURE, 1 - _SURE)
            loss = -np.where(linked > 0, np.log(p), np.log(1 - p))
            found[f"brier_{key}"] = float(((p - linked) ** 2).mean()) if some else None
            found[f"log_loss_{key}"] = float(loss.mean()) if some else None
        for kind in MODELS[:-1] if some else ():  # 0: the map adds nothing to it; 100: no errors
            for score in ("brier", "log_loss"):
                least = found[f"{score}_{kind.name.replace(' ', '_')}"]
                own = found[f"{score}_{SEMANTIC.name.replace(' ', '_')}"]
                key = f"{score}_gain_over_{kind.name.replace(' ', '_')}_percent"
                found[key] = None if not least or own is None else 100 * (1 - own / least)
        return found

    def bins(self) -> dict[str, list[list[float]]]:
        """Of each model, by bins of predicted probability: links, and sums predicted and seen."""
        linked = np.array(self._linked, dtype=np.float64)
        found = {}
        for name, values in self._predicted.items():
            p = np.array(values)
            place = np.minimum((p * BINS).astype(np.intp), BINS - 1)
            sums = [np.bincount(place, weights, BINS) for weights in (None, p, linked)]
            found[name] = [
                [int(count), round(float(expected), 3), float(seen)]
                for count, expected, seen in zip(*sums, strict=True)
            ]
        return found
