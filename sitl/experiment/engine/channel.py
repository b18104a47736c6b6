"""The radio channel as the engine sees it: a port, and the two models behind it.

A model says who is in contact, how long a transmission takes, which transmissions exclude each
other, and in which order those that wait get their turn. What moves is in `channel_sim`.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Sequence
from enum import IntEnum
from itertools import combinations
from typing import Final, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from geo.grid import Terrain
from mocha_link.node.gossip import TIMEOUT_S
from sitl.experiment.settings import PaperModel, PathLossModel
from sitl.world.radio import Antenna, RadioModel
from sitl.world.towns.town import Town

FULL_RATE_DB: Final = 30.0
"""So much above the trigger a link carries all that it can."""

_ROOF_M: Final = 25.0
"""Antennas higher than this look over the buildings."""

_LOOK_S: Final = 1.0
_SAMPLE_M: Final = 1.0

Places = npt.NDArray[np.float64]
"""(robots, 3): east, north, height above ground, in metres."""


class Stage(IntEnum):
    """What a transmission is for; the paper's three stages."""

    HEADER = 0
    DATA = 1
    END = 2


class Link(NamedTuple):
    """One direction of pulling: robots by their number in the run."""

    asking: int
    answering: int


class Load(NamedTuple):
    """What a transmission carries.

    Attributes:
        messages: Robots' messages that arrive whole with it.
        size: Bytes, of the request and of what answers it.
        round_trips: How often one side must wait for the other before it is over.
    """

    stage: Stage
    messages: int
    size: int
    round_trips: int


class Change(NamedTuple):
    """Two robots (a < b) come into contact, or lose it."""

    a: int
    b: int
    up: bool


class Channel(Protocol):
    """A model of the radio channel. Deterministic: seeded, and asked in a fixed order.

    Attributes:
        patience_s: So long an exchange that has lost contact waits for it to come back.
        pull_every_s: In a contact robots pull again so often; None: once, when it begins.
        frame_by_frame: Frames of our protocol cross one at a time; otherwise together until a
            message is whole.
    """

    patience_s: float
    pull_every_s: float | None
    frame_by_frame: bool

    def look(self, now_s: float, places: Places) -> list[Change]:
        """Contacts that began or ended since the last look, in order of the robots' numbers."""

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:
        """How long a transmission that begins now takes."""

    def turn(self, link: Link, ready_s: float) -> tuple[float, ...]:
        """Sorts those that wait for the channel; the least is next."""

    def pick(self, waiting: Iterable[Link], busy: Sequence[Link]) -> int | None:
        """Which of those that wait may begin beside those under way; None: none may."""


class PaperChannel:
    """Exponential latencies per stage, one transmission at a time anywhere, contact by radius.

    Args:
        model: Rates and readings.
        radius_m: Horizontal distance below which two robots are in contact.
        robots: How many there are.
        seed: Makes the latencies.
    """

    def __init__(self, model: PaperModel, radius_m: float, robots: int, seed: int) -> None:
        patience_s = {"timeout": model.timeout_s, "hold": math.inf, "drop": 0.0}
        self.patience_s = patience_s[model.cut]  # from the loss of contact to giving up
        self.pull_every_s = model.pull_every_s  # None: only when a contact begins
        self._order = model.order  # of those that wait: arrival, random or by number
        self.frame_by_frame = model.piece == "frame"  # else a piece of data is a whole message
        self._radius_m = radius_m
        self._rates_1_s = {  # of the exponential latencies
            Stage.HEADER: model.header_rate_1_s,
            Stage.DATA: model.data_rate_1_s,
            Stage.END: model.end_rate_1_s,
        }
        self._chance = random.Random(f"{seed} channel")  # noqa: S311 - repeatable on purpose
        self._near = np.zeros((robots, robots), dtype=bool)  # in contact at the last look
        self._upper = np.triu(np.ones((robots, robots), dtype=bool), 1)  # each pair once

    def look(self, now_s: float, places: Places) -> list[Change]:  # noqa: ARG002 - a port's
        """Who came nearer than the radius, horizontally, and who went."""
        east, north = places[:, 0], places[:, 1]
        squared = (east[:, None] - east) ** 2 + (north[:, None] - north) ** 2
        near = squared < self._radius_m**2
        changed = np.argwhere((near != self._near) & self._upper)
        self._near = near
        return [Change(int(a), int(b), bool(near[a, b])) for a, b in changed]

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:  # noqa: ARG002
        """A latency of the stage; of data one for each message, unless a frame counts as one."""
        rate_1_s = self._rates_1_s[load.stage]
        count = load.stage is Stage.DATA and not self.frame_by_frame
        pieces = max(load.messages, 1) if count else 1
        return math.fsum(self._latency_s(rate_1_s) for _ in range(pieces))

    def turn(self, link: Link, ready_s: float) -> tuple[float, ...]:
        """As the model's reading has it."""
        if self._order == "arrival":
            return (ready_s, *link)
        if self._order == "random":
            return (self._chance.random(), *link)
        return link

    def pick(self, waiting: Iterable[Link], busy: Sequence[Link]) -> int | None:  # noqa: ARG002
        """The first, unless any robot sends anywhere."""
        return None if busy else 0

    def _latency_s(self, rate_1_s: float) -> float:
        return -math.log(1.0 - self._chance.random()) / rate_1_s


class PathLossChannel:
    """A radio as robots have it: power that falls with distance, fades, and is lost in buildings.

    Contact begins and ends by received power, the rate follows from it, and robots that do not hear
    each other send at once. `sitl.world.radio` has the model of the power itself.

    Args:
        model: Powers and rates.
        town: Its buildings.
        names: Of the robots, in the order of their numbers.
        seed: Makes the fading.
    """

    patience_s = TIMEOUT_S
    frame_by_frame = True

    def __init__(self, model: PathLossModel, town: Town, names: Sequence[str], seed: int) -> None:
        self.pull_every_s = model.pull_every_s  # None: only when a contact begins
        self._model = model
        self._names = names
        self._hears: list[set[int]] = []  # by number, and itself; of the last look
        self._raster = town.raster  # buildings that block a radio
        self._radio = RadioModel(
            tx_power_dbm=model.tx_power_dbm,
            reference_loss_db=model.reference_loss_db,
            path_loss_exponent=model.path_loss_exponent,
            ground_to_ground_loss_db=model.ground_to_ground_loss_db,
            shadowing_db=model.shadowing_db,
            shadowing_interval_s=model.shadowing_interval_s,
            sensitivity_dbm=min(model.carrier_dbm, model.trigger_dbm - model.hysteresis_db),
            seed=seed,
        )
        self._farthest_m = self._radio.longest_range_m()  # farther pairs are not looked at
        self._rssi_dbm: dict[tuple[int, int], float] = {}  # at the last look; a < b
        self._up: set[tuple[int, int]] = set()  # in contact, a < b
        self._look_at_s = 0.0  # simulated time of the next look

    def look(self, now_s: float, places: Places) -> list[Change]:
        """What the radios hear now, once a second."""
        if now_s < self._look_at_s:
            return []
        self._look_at_s = now_s + _LOOK_S
        self._measure(now_s, places)
        model, changes = self._model, []
        for pair in combinations(range(len(self._names)), 2):
            least_dbm = model.trigger_dbm - (model.hysteresis_db if pair in self._up else 0.0)
            up = self._rssi_dbm.get(pair, -np.inf) >= least_dbm
            if up != (pair in self._up):
                self._up ^= {pair}
                changes.append(Change(*pair, up))
        return changes

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:  # noqa: ARG002 - a port's
        """Round trips, and the bytes at the rate that the power allows."""
        model = self._model
        rssi_dbm = self._rssi_dbm.get((min(link), max(link)), model.trigger_dbm)
        share = min(max((rssi_dbm - model.trigger_dbm) / FULL_RATE_DB, 0.0), 1.0)
        rate = model.least_rate_bytes_s + share * (model.rate_bytes_s - model.least_rate_bytes_s)
        return load.round_trips * model.round_trip_s + load.size / rate

    def turn(self, link: Link, ready_s: float) -> tuple[float, ...]:
        """Who has waited longest."""
        return (ready_s, *link)

    def pick(self, waiting: Iterable[Link], busy: Sequence[Link]) -> int | None:
        """The first that disturbs no transmission and is not disturbed."""
        deaf = {number for link in busy for each in link for number in self._hears[each]}
        for place, (asking, answering) in enumerate(waiting):
            if asking not in deaf and answering not in deaf:
                return place
        return None

    def _measure(self, now_s: float, places: Places) -> None:
        away_m = np.sqrt(((places[:, None] - places) ** 2).sum(axis=2))
        antennas = [
            Antenna(float(east), float(north), float(up), on_ground=up < _ROOF_M)
            for east, north, up in places
        ]
        self._rssi_dbm.clear()
        self._hears = [{number} for number in range(len(self._names))]
        for row in np.argwhere(np.triu(away_m <= self._farthest_m, 1)):
            a, b = int(row[0]), int(row[1])
            rssi_dbm = self._radio.rssi_dbm(
                self._names[a], antennas[a], self._names[b], antennas[b], now_s
            )
            if rssi_dbm < self._radio.sensitivity_dbm:
                continue
            if antennas[a].on_ground and antennas[b].on_ground:
                rssi_dbm -= self._building_db(places[a], places[b])
            self._rssi_dbm[a, b] = round(rssi_dbm, 6)
            if rssi_dbm >= self._model.carrier_dbm:
                self._hears[a].add(b)
                self._hears[b].add(a)

    def _building_db(self, start: Places, end: Places) -> float:
        """What a straight line through the town loses in buildings."""
        east_m, north_m = end[0] - start[0], end[1] - start[1]
        count = max(2, int(np.hypot(east_m, north_m) / _SAMPLE_M))
        along = (np.arange(count) + 0.5) / count
        classes = self._raster.classes_at(start[0] + along * east_m, start[1] + along * north_m)
        building_m = np.count_nonzero(classes == Terrain.BUILDING) * _SAMPLE_M
        model = self._model
        return float(min(model.most_building_db, model.building_loss_db_m * building_m))
