"""What a conversation expects to be heard: messages, texts, events, modes; or nothing."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from sitl.conformance.line import Link
from sitl.conformance.modes import mode_name
from sitl.conformance.steps import Fields
from sitl.conformance.talk import DepartureError, Talk
from sitl.conformance.words import event_id


@dataclass(frozen=True)
class Hear:
    """A message that is to come within some seconds of the vehicle's time.

    Attributes:
        name: Of the message.
        fields: Values that it is to have; floats within 1e-3 or so.
        within_s: How long to wait.
        link: On which link.
        times: How often, in that time.
    """

    name: str
    fields: Fields = field(default_factory=dict)
    within_s: float = 2.0
    link: Link = Link.API
    times: int = 1

    def play(self, talk: Talk) -> None:
        """See `Step`."""

        def come() -> bool:
            matching = [
                heard
                for heard in talk.since(self.name, self.link)
                if same(heard.fields, self.fields)
            ]
            return len(matching) >= self.times

        if not talk.run(self.within_s, come):
            shown = [
                shorten(heard.fields, self.fields) for heard in talk.since(self.name, self.link)
            ]
            raise DepartureError(
                f"expected {self.name} {self.fields or ''} within {self.within_s:g} s, "
                f"heard {shown or 'none'}"
            )


@dataclass(frozen=True)
class Silence:
    """A message that is not to come for some seconds, nor has since the exchange began."""

    name: str
    for_s: float
    fields: Fields = field(default_factory=dict)
    link: Link = Link.API

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        talk.run(self.for_s)
        came = [
            shorten(heard.fields, self.fields)
            for heard in talk.since(self.name, self.link)
            if same(heard.fields, self.fields)
        ]
        if came:
            raise DepartureError(f"expected no {self.name} for {self.for_s:g} s, heard {came}")


@dataclass(frozen=True)
class Text:
    """A STATUSTEXT that begins so, on a link with a ground station."""

    begin: str
    within_s: float = 3.0
    link: Link = Link.API

    def play(self, talk: Talk) -> None:
        """See `Step`."""

        def come() -> bool:
            return any(text.startswith(self.begin) for text in talk.texts(self.link))

        if not talk.run(self.within_s, come):
            raise DepartureError(f"expected the text '{self.begin}', heard {talk.texts(self.link)}")


@dataclass(frozen=True)
class Event:
    """An EVENT, by PX4's name of it."""

    name: str
    within_s: float = 3.0
    arguments: bytes = b""

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        wanted = event_id(self.name)

        def come() -> bool:
            return any(
                heard.fields["id"] == wanted
                and bytes(heard.fields["arguments"]).startswith(self.arguments)
                for heard in talk.since("EVENT")
            )

        if not talk.run(self.within_s, come):
            ids = [heard.fields["id"] for heard in talk.since("EVENT")]
            raise DepartureError(f"expected the event {self.name} ({wanted}), heard {ids}")


@dataclass(frozen=True)
class InMode:
    """The mode that HEARTBEAT shows within some seconds; others before it do not matter.

    Attributes:
        mode: Name of a `FlightMode`.
        within_s: How long to wait.
        status: HEARTBEAT.system_status with it.
        intended: CURRENT_MODE.intended_custom_mode's mode.
        armed: Whether the motors turn.
    """

    mode: str
    within_s: float = 2.5
    status: int | None = None
    intended: str | None = None
    armed: bool | None = None

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        since_s = talk.now_s

        def shown() -> bool:
            beats = [beat for beat in talk.since("HEARTBEAT") if beat.at_s >= since_s]
            return any(self._fits(beat.fields) for beat in beats)

        if not talk.run(self.within_s, shown):
            beat = talk.newest("HEARTBEAT") or {"custom_mode": 0, "base_mode": 0}
            raise DepartureError(f"expected {self}, it is {describe(beat)}")
        if self.intended is not None and not talk.run(2.5, lambda: self._intended(talk)):
            raise DepartureError(f"expected {self}, CURRENT_MODE is {talk.newest('CURRENT_MODE')}")

    def _fits(self, beat: Fields) -> bool:
        return (
            mode_name(beat["custom_mode"]) == self.mode
            and self.status in (None, beat["system_status"])
            and self.armed in (None, bool(beat["base_mode"] & 128))
        )

    def _intended(self, talk: Talk) -> bool:
        current = talk.newest("CURRENT_MODE") or {"intended_custom_mode": 0}
        return mode_name(current["intended_custom_mode"]) == self.intended


@dataclass(frozen=True)
class StaysInMode:
    """The mode does not change for some seconds."""

    mode: str
    for_s: float

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        InMode(self.mode, 2.5).play(talk)
        talk.mark()
        talk.run(self.for_s)
        seen = {mode_name(beat.fields["custom_mode"]) for beat in talk.since("HEARTBEAT")}
        if seen - {self.mode}:
            raise DepartureError(f"expected {self.mode} for {self.for_s:g} s, saw {sorted(seen)}")


def describe(beat: Fields) -> str:
    """A HEARTBEAT in words."""
    armed = "armed" if beat["base_mode"] & 128 else "disarmed"
    return f"{mode_name(beat['custom_mode'])}, {armed}, status {beat.get('system_status')}"


def same(fields: Fields, wanted: Fields) -> bool:
    """Whether a message has the wanted values; a set stands for any of its members."""
    return all(_equal(fields[name], value) for name, value in wanted.items())


def shorten(fields: Fields, wanted: Iterable[str]) -> Fields:
    """The fields that matter."""
    names = set(wanted)
    return {name: value for name, value in fields.items() if not names or name in names}


def _equal(value: Any, wanted: Any) -> bool:
    if isinstance(wanted, frozenset | set):
        return value in wanted
    if isinstance(wanted, float):
        if math.isnan(wanted):
            return isinstance(value, float) and math.isnan(value)
        return math.isclose(value, wanted, rel_tol=1e-5, abs_tol=1e-3)
    return bool(value == wanted)
