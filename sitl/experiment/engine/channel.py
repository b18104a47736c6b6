"""The radio channel as the engine sees it, and the two models of it.

A model decides who is in contact, how long a transmission takes, which transmissions exclude each
other, and in which order those that wait get their turn. What moves is in `channel_sim`.
"""

from __future__ import annotations

import math
import random
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from enum import IntEnum
from operator import itemgetter
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from mocha_link.node import TIMEOUT_S
from sitl.experiment import PaperModel, PathLossModel
from sitl.world import AirLoss, Obstacles, RadioModel, TownRadio, air_loss
from sitl.world.towns import Town

FULL_RATE_DB: Final = 30.0
"""So much above the trigger a link carries all that it can."""

_LOOK_S: Final = 1.0

_WIFI: Final = (
    *((-82, 6.5), (-79, 13.0), (-77, 19.5), (-74, 26.0)),
    *((-70, 39.0), (-66, 52.0), (-65, 58.5), (-64, 65.0)),
)
"""IEEE 802.11n, 20 MHz, one stream: the least power in dBm for each rate in Mbit/s (minimum input
sensitivity of receivers for MCS 0 to 7, and their rates with a guard interval of 800 ns)."""

_WIFI_SHARE: Final = 0.5
"""So much of that rate is left for robots' messages: frames' heads, answers and back-offs take the
rest. A reading; 802.11 does not state it."""

Places = npt.NDArray[np.float64]
"""(robots, 3): east, north, height above ground, in metres."""


class Stage(IntEnum):
    """What a transmission is for; the paper's three stages."""

    HEADER = 0
    DATA = 1
    END = 2


class Link(NamedTuple):
    """One direction of pulling: robots by their number in the run."""

    requesting: int
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


class Channel(ABC):
    """A model of the radio channel. Deterministic: seeded, and queried in a fixed order.

    Attributes:
        patience_s: So long an exchange that has lost contact waits for it to come back.
        pull_every_s: In a contact robots pull again so often; None: once, when it begins.
        frame_by_frame: Frames of our protocol cross one at a time; otherwise together until a
            message is whole.
    """

    patience_s: float = TIMEOUT_S
    pull_every_s: float | None = None
    frame_by_frame: bool = True

    @abstractmethod
    def update(self, now_s: float, places: Places) -> list[Change]:
        """Contacts that began or ended since the last update, in order of the robots' numbers."""

    @abstractmethod
    def duration_s(self, link: Link, load: Load, now_s: float) -> float:
        """How long a transmission that begins now takes."""

    def turn(self, link: Link, ready_s: float) -> tuple[float, ...]:
        """Sorts those that wait for the channel, the least is next: who has waited longest."""
        return (ready_s, *link)

    def occupied(self, busy: Sequence[Link]) -> AbstractSet[int]:  # noqa: ARG002
        """Robots that can take no part in another transmission beside those under way."""
        return frozenset()


LINKED_S: Final = 10.0
"""Robots that are always linked pull so often."""


class LinkedChannel(Channel):
    """Every robot is always in contact with one of them, and transmissions take no time.

    Args:
        hub: The number of the robot that all others are linked with.
        robots: How many there are.
    """

    pull_every_s = LINKED_S

    def __init__(self, hub: int, robots: int) -> None:
        others = (number for number in range(robots) if number != hub)
        self._changes = [Change(min(hub, each), max(hub, each), up=True) for each in others]

    def update(self, now_s: float, places: Places) -> list[Change]:  # noqa: ARG002 - a port's
        """All contacts begin at once, and none ends."""
        changes, self._changes = self._changes, []
        return changes

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:  # noqa: ARG002
        """Nothing."""
        return 0.0


class PaperChannel(Channel):
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
        self._robots = frozenset(range(robots))
        self._near = np.zeros((robots, robots), dtype=bool)  # in contact at the last update
        self._upper = np.triu(np.ones((robots, robots), dtype=bool), 1)  # each pair once

    def update(self, now_s: float, places: Places) -> list[Change]:  # noqa: ARG002 - a port's
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
        return math.fsum(-math.log(1.0 - self._chance.random()) / rate_1_s for _ in range(pieces))

    def turn(self, link: Link, ready_s: float) -> tuple[float, ...]:
        """As the model's reading has it."""
        if self._order == "random":
            return (self._chance.random(), *link)
        return link if self._order == "fixed" else super().turn(link, ready_s)

    def occupied(self, busy: Sequence[Link]) -> AbstractSet[int]:
        """All of them, once any robot sends anywhere."""
        return self._robots if busy else frozenset()


class PathLossChannel(Channel):
    """A radio as robots have it: power that falls with distance, fades, and is lost in buildings.

    Contact begins and ends by received power, the rate follows from it, and robots that do not
    receive each other send at once. `sitl.world.radio` has the model of the power itself.

    Args:
        model: Powers and rates.
        town: Its buildings.
        names: Of the robots, in the order of their numbers.
        seed: Makes the fading.
    """

    def __init__(self, model: PathLossModel, town: Town, names: Sequence[str], seed: int) -> None:
        self.pull_every_s = model.pull_every_s  # None: only when a contact begins
        self._model = model
        radio = RadioModel.model_construct(  # an experiment may set more than a world file
            shadowing_db=model.shadowing_db,
            sensitivity_dbm=min(model.carrier_dbm, model.trigger_dbm - model.hysteresis_db),
        )
        loss: AirLoss | None = None
        if model.air == "obstacles":
            loss = Obstacles(
                *(town, model.carrier_ghz, seed),
                building_loss_db_m=model.building_loss_db_m,
                most_building_db=model.most_building_db,
            )
        elif model.air != "log_distance":
            loss = air_loss(model.air, model.carrier_ghz, seed)
        self._radio = TownRadio(
            *(radio, town.raster, names, seed),
            building_loss_db_m=model.building_loss_db_m,
            most_building_db=model.most_building_db,
            air=loss,
        )
        # All by the numbers of both robots, and the same in both directions:
        self._rssi_dbm = np.full((len(names), len(names)), -np.inf)  # at the last look
        self._senses: npt.NDArray[np.bool_] = np.eye(len(names), dtype=bool)  # or is itself
        self._up = np.zeros((len(names), len(names)), dtype=bool)  # in contact
        self._next_update_s = 0.0  # simulated time of the next update

    def update(self, now_s: float, places: Places) -> list[Change]:
        """The contacts of the radios now, once a second."""
        if now_s < self._next_update_s:
            return []
        self._next_update_s = now_s + _LOOK_S
        self._rssi_dbm = self._radio.rssi_dbm(now_s, places)
        self._senses = self._rssi_dbm >= self._model.carrier_dbm
        np.fill_diagonal(self._senses, val=True)
        up = self._rssi_dbm >= self._model.trigger_dbm - self._model.hysteresis_db * self._up
        changed = np.argwhere(np.triu(up != self._up)).tolist()
        self._up = up
        return [Change(a, b, bool(up[a, b])) for a, b in changed]

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:  # noqa: ARG002 - a port's
        """Round trips, and the bytes at the rate that the power allows."""
        rate = self._rate_bytes_s(float(self._rssi_dbm[link]))
        return load.round_trips * self._model.round_trip_s + load.size / rate

    def _rate_bytes_s(self, rssi_dbm: float) -> float:
        model = self._model
        if model.rates == "802.11n":
            place = bisect_right(_WIFI, rssi_dbm, key=itemgetter(0))
            return _WIFI[max(place - 1, 0)][1] * 1e6 / 8 * _WIFI_SHARE
        share = min(max((rssi_dbm - model.trigger_dbm) / FULL_RATE_DB, 0.0), 1.0)
        return model.least_rate_bytes_s + share * (model.rate_bytes_s - model.least_rate_bytes_s)

    def occupied(self, busy: Sequence[Link]) -> AbstractSet[int]:
        """Those that would disturb a transmission or be disturbed."""
        sending = [number for link in busy for number in link]
        return set(np.flatnonzero(np.any(self._senses[sending], axis=0)).tolist())
