"""What is looked at every few seconds of a run: places, and how old everybody's knowledge is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from air_router.messages import MAP_TOPIC, POSE_TOPIC
from sitl.experiment.channels.channel import Places
from sitl.experiment.robots.node import Node

_Floats = npt.NDArray[np.float32]


class Samples:
    """Takes samples; every array has one row per sample.

    Args:
        nodes: In the order of their numbers.
        mappers: Numbers of those that publish maps.
    """

    def __init__(self, nodes: Sequence[Node], mappers: Sequence[int]) -> None:
        self._nodes = nodes
        self._mappers = mappers
        self._times_s: list[float] = []
        self._places: list[_Floats] = []
        self._pose_ages_s: list[_Floats] = []
        self._map_ages_s: list[_Floats] = []
        self._shares: list[float] = []

    def take(self, now_s: float, places: Places, known_share: float) -> None:
        """Look at everybody now."""
        self._times_s.append(now_s)
        self._places.append(places[:, :2].astype(np.float32))
        self._shares.append(known_share)
        count = len(self._nodes)
        ages_s = np.zeros((count, count), dtype=np.float32)
        maps_s = np.zeros(count, dtype=np.float32)
        for node in self._nodes:
            for other in self._nodes:
                if other is not node:
                    ages_s[node.number, other.number] = node.age_s(other.name, POSE_TOPIC)
            if node.number not in self._mappers:
                maps_s[node.number] = min(
                    (node.age_s(self._nodes[each].name, MAP_TOPIC) for each in self._mappers),
                    default=np.inf,
                )
        self._pose_ages_s.append(ages_s)
        self._map_ages_s.append(maps_s)

    @property
    def times_s(self) -> npt.NDArray[np.float64]:
        """When samples were taken."""
        return np.array(self._times_s)

    @property
    def positions_m(self) -> _Floats:
        """(samples, robots, 2)."""
        return np.array(self._places, dtype=np.float32)

    @property
    def pose_age_s(self) -> _Floats:
        """(samples, robots, robots)."""
        return np.array(self._pose_ages_s, dtype=np.float32)

    @property
    def map_age_s(self) -> _Floats:
        """(samples, robots)."""
        return np.array(self._map_ages_s, dtype=np.float32)

    @property
    def known_share(self) -> _Floats:
        """(samples,)."""
        return np.array(self._shares, dtype=np.float32)
