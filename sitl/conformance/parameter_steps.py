"""Steps about parameters, and about how often what is sent."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any, Final

from sitl.conformance.line import Link
from sitl.conformance.talk import DepartureError, Talk

INT32: Final = 6  # MAV_PARAM_TYPE
REAL32: Final = 9
_QUIET_S: Final = 1.0


@dataclass(frozen=True)
class SetParameter:
    """PARAM_SET, and the PARAM_VALUEs that answer it.

    Attributes:
        name: Of the parameter.
        value: An int is sent as INT32, bytewise, as PX4 has it.
        answers: How many PARAM_VALUEs come: two (on a busy machine sometimes three) for a change,
            one for none, none if refused.
        as_type: MAV_PARAM_TYPE that is written on it, instead of the value's own.
    """

    name: str
    value: float
    answers: int = 2
    as_type: int | None = None

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        whole = isinstance(self.value, int)
        own_type = INT32 if whole else REAL32
        sent = struct.unpack("<f", struct.pack("<i", self.value))[0] if whole else self.value
        talk.mark()
        talk.say(
            "PARAM_SET",
            target_system=talk.vehicle_id,
            target_component=1,
            param_id=self.name.encode(),
            param_value=sent,
            param_type=own_type if self.as_type is None else self.as_type,
        )
        values = _values(talk, self.name, self.answers)
        talk.notes.append(f"{self.name}: {len(values)} answers {values}")
        wanted = struct.unpack("<f", struct.pack("<f", self.value))[0]
        enough = len(values) >= 2 if self.answers == 2 else len(values) == self.answers
        if not enough or any(abs(value - wanted) > 1e-6 for value in values):
            raise DepartureError(f"expected {self.answers} PARAM_VALUEs, heard {values}")


@dataclass(frozen=True)
class ReadParameter:
    """PARAM_REQUEST_READ by name; the value that comes, or None for silence."""

    name: str
    value: float | None

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        talk.mark()
        talk.say(
            "PARAM_REQUEST_READ",
            target_system=talk.vehicle_id,
            target_component=1,
            param_id=self.name.encode(),
            param_index=-1,
        )
        wanted = 0 if self.value is None else 1
        values = _values(talk, self.name, wanted)
        if len(values) != wanted or (
            self.value is not None and abs(values[0] - self.value) > 1e-6 * max(1.0, self.value)
        ):
            raise DepartureError(
                f"expected {self.name} = {self.value}, heard {values or 'silence'}"
            )


def read_value(talk: Talk, name: str) -> float:
    """The value of a parameter: an int where PX4 has one.

    Raises:
        DepartureError: no answer.
    """
    talk.mark()
    talk.say("PARAM_REQUEST_READ", **talk.target, param_id=name.encode(), param_index=-1)
    values = _values(talk, name, 1)
    if not values:
        raise DepartureError(f"expected the parameter {name}, heard silence")
    whole = talk.since("PARAM_VALUE")[-1].fields["param_type"] == INT32
    return int(values[0]) if whole else values[0]


@dataclass(frozen=True)
class ListParameters:
    """PARAM_REQUEST_LIST: every parameter comes, within a time.

    Attributes:
        fewest: Parameters, at least.
        within_s: Until the last has come.
        among: Names that are among them.
    """

    fewest: int
    within_s: float
    among: tuple[str, ...] = ()

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        talk.mark()
        talk.say("PARAM_REQUEST_LIST", target_system=talk.vehicle_id, target_component=1)
        names: set[str] = set()
        counts: set[int] = set()

        def complete() -> bool:
            for heard in talk.since("PARAM_VALUE"):
                if heard.fields["param_index"] < 65535:
                    names.add(heard.fields["param_id"])
                    counts.add(heard.fields["param_count"])
            return bool(counts) and len(names) >= max(counts)

        begun_s = talk.now_s
        done = talk.run(self.within_s, complete)
        talk.notes.append(f"{len(names)} parameters in {talk.now_s - begun_s:.2f} s")
        missing = [name for name in self.among if name not in names]
        if not done or len(names) < self.fewest or missing:
            raise DepartureError(
                f"expected {self.fewest} parameters within {self.within_s:g} s, "
                f"heard {len(names)} of {counts}, without {missing}"
            )


@dataclass(frozen=True)
class Rates:
    """How often messages come by themselves, per second of the vehicle's time.

    Attributes:
        wanted: Least and most rate by name.
        for_s: How long to count.
        link: On which link.
    """

    wanted: dict[str, tuple[float, float]] = field(default_factory=dict)
    for_s: float = 10.0
    link: Link = Link.API

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        before, begun_s = talk.counts.copy(), talk.now_s
        talk.run(self.for_s)
        seconds = talk.now_s - begun_s
        rates = {
            name: (talk.counts[self.link, name] - before[self.link, name]) / seconds
            for name in self.wanted
        }
        talk.notes.append(", ".join(f"{name} {rate:.1f}" for name, rate in rates.items()))
        wrong = {
            name: f"{rate:.2f}"
            for name, rate in rates.items()
            if not self.wanted[name][0] <= rate <= self.wanted[name][1]
        }
        if wrong:
            wanted = {name: self.wanted[name] for name in wrong}
            raise DepartureError(f"expected rates {wanted}, counted {wrong}")


def _values(talk: Talk, name: str, wanted: int) -> list[float]:
    def values() -> list[float]:
        return [
            _value(heard.fields)
            for heard in talk.since("PARAM_VALUE")
            if heard.fields["param_id"] == name
        ]

    talk.run(_QUIET_S, lambda: wanted > 0 and len(values()) >= wanted)
    talk.run(0.2)
    return values()


def _value(fields: dict[str, Any]) -> float:
    if fields["param_type"] == INT32:
        return float(struct.unpack("<i", struct.pack("<f", fields["param_value"]))[0])
    return float(fields["param_value"])
