"""The link between companion and vehicle in simulated time, and all that goes wrong with it."""

from __future__ import annotations

import heapq
import itertools
import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

LEAST_S: Final = 0.005
"""What a message takes at least, either way; a command up to `MOST_S`."""

MOST_S: Final = 0.03
DELAYED_S: Final = 2.0
"""How long the vehicle's messages keep coming so late, where they come late."""

CLOCKS: Final = ("time_boot_ms", "time_usec", "event_time_boot_ms")
"""Fields that carry the vehicle's clock."""

Fields = Mapping[str, Any]


class Way(Enum):
    """The direction of a message."""

    DOWN = "from the vehicle"
    UP = "to the vehicle"


class StreamFault(Enum):
    """What can be the matter with the messages of one name."""

    LOST = "lost"
    FROZEN = "frozen"  # the values of the last good one; the clock in it goes on
    REPEATED = "repeated"  # the last good one, again and again
    LATE = "late"  # each by some seconds
    WRONG = "wrong"  # believable, and not true


Wrong = Callable[[dict[str, Any], random.Random], dict[str, Any]]


_POSCTL: Final = 3 << 16
_METRES_E7: Final = 90  # of latitude, about, in 1e-7 degrees

_VALUES: Final[dict[str, Callable[[random.Random], dict[str, Any]]]] = {
    "SYS_STATUS": lambda rng: {"battery_remaining": rng.choice((-1, 3, 50, 100))},
    "GPS_RAW_INT": lambda rng: {"fix_type": rng.choice((0, 1, 3)), "satellites_visible": 3},
    "EXTENDED_SYS_STATE": lambda rng: {"landed_state": rng.choice((0, 1, 2, 4))},
    "MISSION_CURRENT": lambda rng: {"seq": rng.randrange(0, 60)},
    "HEARTBEAT": lambda rng: {"custom_mode": rng.choice((_POSCTL, 0x03040000, 0x04040000))},
    "CURRENT_MODE": lambda rng: {"custom_mode": rng.choice((_POSCTL, 0x03040000, 0x04040000))},
}


@dataclass(frozen=True, slots=True)
class _ActiveFault:
    """A stream's fault and when it is over."""

    kind: StreamFault
    until_s: float
    late_s: float
    wrong: Wrong | None


@dataclass(frozen=True, slots=True)
class Burst:
    """Losses that come in bursts (Gilbert and Elliott): mean lengths, and the share lost in one."""

    good_s: float
    bad_s: float
    loss: float


class Link:
    """Carries messages both ways, in order, with a delay.

    Args:
        chance: The random generator.

    Attributes:
        loss: Share of messages that are lost, either way.
        late_s: Commands take up to so much longer, one behind the other.
        old_s: The vehicle's messages take up to so long.
        silent: Nothing passes.
        burst: Losses in bursts; None: none.
        booted_s: When the vehicle's clock began anew; 0: with ours.
    """

    def __init__(self, chance: random.Random) -> None:
        self._chance = chance
        self.loss = self.late_s = self.old_s = 0.0
        self.silent = False
        self.burst: Burst | None = None
        self._in_burst, self._turns_s = False, 0.0  # `burst` is in its bad part; till when
        self._count = itertools.count()  # keeps the order of what arrives at the same time
        self._under_way: list[tuple[float, int, Callable[[], object]]] = []  # heap: when, order
        self._arrives_s = dict.fromkeys(Way, 0.0)  # of the last one: none overtakes it
        self._delay_s, self._other_delay_s = 0.0, 0.0  # of the vehicle's messages; till when
        self._troubles: dict[tuple[Way, str], _ActiveFault] = {}  # one for each stream
        self._frozen: dict[tuple[Way, str], Fields] = {}  # what a stream repeats
        self.booted_s = 0.0

    @property
    def next_s(self) -> float:
        """When the next message arrives."""
        return self._under_way[0][0] if self._under_way else math.inf

    def trouble(  # noqa: PLR0913 - all properties of a bad link
        self,
        way: Way,
        name: str,
        kind: StreamFault,
        until_s: float,
        *,
        late_s: float = 3.0,
        wrong: Wrong | None = None,
    ) -> None:
        """Something is the matter with one stream until then."""
        self._frozen.pop((way, name), None)
        self._troubles[(way, name)] = _ActiveFault(kind, until_s, late_s, wrong)

    def send(
        self,
        way: Way,
        name: str,
        fields: Fields,
        now_s: float,
        arrive: Callable[[Fields], object],
    ) -> bool:
        """Send a message; whether it will arrive."""
        if not self._passes(now_s):
            return False
        arrives_s = max(now_s + self._takes_s(way, now_s), self._arrives_s[way])
        self._arrives_s[way] = arrives_s
        trouble = self._troubles.get((way, name))
        if way is Way.DOWN and self.booted_s > 0.0:
            fields = self._by_new_clock(fields)
        if trouble is not None and now_s < trouble.until_s:
            match trouble.kind:
                case StreamFault.LOST:
                    return False
                case StreamFault.REPEATED:
                    fields = self._frozen.setdefault((way, name), fields)
                case StreamFault.FROZEN:
                    clock = {field: fields[field] for field in CLOCKS if field in fields}
                    fields = {**self._frozen.setdefault((way, name), fields), **clock}
                case StreamFault.LATE:
                    arrives_s += trouble.late_s
                case StreamFault.WRONG:
                    if trouble.wrong is not None:
                        fields = trouble.wrong(dict(fields), self._chance)
        entry = (arrives_s, next(self._count), lambda: arrive(fields))
        heapq.heappush(self._under_way, entry)
        return True

    def deliver(self, now_s: float) -> None:
        """What arrives until now."""
        while self._under_way and self._under_way[0][0] <= now_s:
            heapq.heappop(self._under_way)[2]()

    def _takes_s(self, way: Way, now_s: float) -> float:
        if way is Way.UP:
            takes_s = self._chance.uniform(LEAST_S, MOST_S)
            return takes_s + (self._chance.uniform(0.0, self.late_s) if self.late_s else 0.0)
        if self.old_s > 0.0 and now_s >= self._other_delay_s:
            self._delay_s = self._chance.uniform(0.0, self.old_s)
            self._other_delay_s = now_s + DELAYED_S
        return LEAST_S + self._delay_s

    def _passes(self, now_s: float) -> bool:
        if self.silent:
            return False
        loss = self.loss
        burst = self.burst
        if burst is not None:
            if now_s >= self._turns_s:
                self._in_burst = not self._in_burst
                mean_s = burst.bad_s if self._in_burst else burst.good_s
                self._turns_s = now_s + self._chance.expovariate(1.0 / mean_s)
            if self._in_burst:
                loss = max(loss, burst.loss)
        return loss <= 0.0 or self._chance.random() >= loss

    def _by_new_clock(self, fields: Fields) -> Fields:
        changed = dict(fields)
        for name in CLOCKS:
            if name in changed:
                scale = 1e6 if name.endswith("usec") else 1e3
                changed[name] = max(0, changed[name] - round(self.booted_s * scale))
        return changed


def wrong_of(name: str, rng: random.Random) -> Wrong | None:
    """The false values of messages of one name; None: that name has none."""
    if name == "GLOBAL_POSITION_INT":
        off = [round(rng.uniform(-30.0, 30.0) * _METRES_E7) for _ in range(2)]
        up_mm = round(rng.uniform(-8.0, 8.0) * 1e3)

        def elsewhere(fields: dict[str, Any], _: random.Random) -> dict[str, Any]:
            there = {"lat": fields["lat"] + off[0], "lon": fields["lon"] + off[1]}
            return {**fields, **there, "relative_alt": fields["relative_alt"] + up_mm}

        return elsewhere
    value = _VALUES.get(name)
    return None if value is None else lambda fields, d: {**fields, **value(d)}
