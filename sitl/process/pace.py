"""Who keeps up with the world's clock, and how far it may go: decisions only, no sockets or clocks.

The simulated vehicle's clock is the world's. Every other process that works with it (team,
companion, other vehicles) reports how far it has worked; the world waits for the slowest.
"""

import math
import socket
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any, Final

from air_router.vehicle import PACE_ALLOWANCE_S, PACE_STEP_S
from mocha_link.lifetime import Closeable

PATIENCE_S: Final = 2.0
"""Wall-clock seconds that the world stands still for one process; a vehicle that is silent for
three is lost to its companion."""

STARTING_SPEED: Final = 5.0
"""Times real time until everyone takes part: programs start and talk at the wall's pace."""

STALLED_SPEED: Final = 1.0
"""The same while one that takes part has not reported for `PATIENCE_S`."""

_SOON_S: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Limit:
    """How the world may go on now.

    Attributes:
        until_s: Simulated time that it must not step beyond.
        most_speed: Times real time.
    """

    until_s: float = math.inf
    most_speed: float = math.inf


@dataclass(slots=True)
class _Record:
    """The figures of a process in `Pace.as_json`."""

    behind_s: float = 0.0
    waited_s: float = 0.0
    lost_s: float | None = None


@dataclass(slots=True)
class _Participant:
    """A process that takes part.

    Attributes:
        reached_s: Simulated time up to which it has worked; None: it has not reported yet.
        holds_since_s: Wall time from when on the world has stood still for it.
        record: Its figures in the result.
    """

    reached_s: float | None = None
    holds_since_s: float | None = None
    record: _Record = field(default_factory=_Record)


class Pace(Closeable):
    """Whom the world's clock waits for; this one has no connections: it waits for no process.

    Times are the vehicle's simulated seconds, and wall-clock seconds of any steady clock.

    Until everyone who is expected has reported once, the world goes slowly, and at real time while
    one of them does not report for `PATIENCE_S` (it was stopped, or hangs). One that has left is
    not waited for.

    Args:
        expected: How many processes take part beside the vehicle whose clock it is.
    """

    def __init__(self, expected: int = 0) -> None:
        self._missing = expected
        self._present: dict[object, _Participant] = {}  # by connection
        self._records: dict[str, _Record] = {}  # by name; also of those that left
        self._began: tuple[float, float] | None = None  # simulated and wall time when all took part
        self._now: tuple[float, float] | None = None  # the same, at the last `limit`

    @property
    def sockets(self) -> Collection[socket.socket]:
        """What to `select` on."""
        return ()

    def attend(self, ready: Collection[object]) -> bool:  # noqa: ARG002 - there are no sockets
        """Read what has come; whether the world may go farther than before."""
        return False

    def close(self) -> None:
        """Close all sockets; from now on no process is waited for."""

    def joined(self, key: object) -> None:
        """A process has connected; `key` stands for its connection."""
        self._present[key] = _Participant()

    def reached(self, key: object, name: str, time_s: float, wall_s: float) -> None:
        """A process has worked up to a time."""
        participant = self._present[key]
        record = participant.record = self._records.setdefault(name, _Record())
        before_s, participant.reached_s = participant.reached_s, time_s
        if before_s is None:
            self._missing -= 1
        elif participant.holds_since_s is not None and time_s > before_s:
            record.waited_s += min(wall_s - participant.holds_since_s, PATIENCE_S)
            participant.holds_since_s = None
        if self._now is not None:
            record.behind_s = max(record.behind_s, self._now[0] - time_s)

    def left(self, key: object) -> None:
        """A connection has ended."""
        participant = self._present.pop(key)
        if participant.reached_s is None:
            self._missing -= 1

    def limit(self, time_s: float, wall_s: float, received_s: float = math.inf) -> Limit:
        """How far the world may go.

        Args:
            time_s: Where it is now.
            wall_s: When.
            received_s: The newest moment that reached the processes. A link loses later ones: one
                that has worked up to this moment does not know of it, and is not waited for.
        """
        most_speed = STARTING_SPEED if self._missing > 0 else math.inf
        until_s = math.inf
        for participant in self._present.values():
            if participant.reached_s is None or participant.reached_s > received_s - PACE_STEP_S:
                continue
            its_limit_s = participant.reached_s + PACE_ALLOWANCE_S
            if time_s > its_limit_s - _SOON_S:
                if participant.holds_since_s is None:
                    participant.holds_since_s = wall_s
                if wall_s - participant.holds_since_s > PATIENCE_S:
                    most_speed, record = STALLED_SPEED, participant.record
                    record.lost_s = round(time_s, 2) if record.lost_s is None else record.lost_s
                    continue
            until_s = min(until_s, its_limit_s)
        self._now = (time_s, wall_s)
        if self._began is None and self._missing <= 0:
            self._began = self._now
        return Limit(until_s, most_speed)

    def as_json(self, speed: float) -> dict[str, Any]:
        """For a result: the rate requested and kept since all took part, and the lags.

        `behind_s` is in simulated seconds, `waited_s` in wall-clock seconds that the world stood;
        `lost_s` is the simulated time when it first went on without the process, None if never.
        """
        kept = None
        if self._began is not None and self._now is not None:
            wall_s = self._now[1] - self._began[1]
            kept = round((self._now[0] - self._began[0]) / wall_s, 2) if wall_s > 0 else None
        return {
            "requested": speed,
            "kept": kept,
            "processes": {
                name: {
                    "behind_s": round(of.behind_s, 2),
                    "waited_s": round(of.waited_s, 2),
                    "lost_s": of.lost_s,
                }
                for name, of in self._records.items()
            },
        }
