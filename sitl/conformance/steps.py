"""What a conversation is made of: commands, waits, and what is expected to be heard."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

from sitl.commands import CommandResult
from sitl.conformance.line import Link
from sitl.conformance.modes import mode_name
from sitl.conformance.talk import DepartureError, Stream, Talk
from sitl.conformance.words import event_id
from sitl.px4_modes import FlightMode

_EXTRA_S: Final = 0.3
NOWHERE: Final = 2**31 - 1
Fields = dict[str, Any]


class Step(Protocol):
    """One thing said, or waited for, or expected."""

    def play(self, talk: Talk) -> None:
        """Do it.

        Raises:
            DepartureError: the vehicle did something else.
        """


@dataclass(frozen=True)
class Command:
    """A COMMAND_LONG, and the results that COMMAND_ACK gives, in their order.

    Attributes:
        number: MAV_CMD.
        params: param1 to param7; those that are missing are NaN.
        answers: Names of MAV_RESULT; none: silence is expected.
        within_s: How long to wait for them.
        target: System and component id; None: the vehicle's autopilot.
    """

    number: int
    params: tuple[float, ...] = ()
    answers: tuple[str, ...] = ("ACCEPTED",)
    within_s: float = 1.0
    target: tuple[int, int] | None = None

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        padded = (*self.params, *(math.nan,) * (7 - len(self.params)))
        fields: Fields = {f"param{number + 1}": value for number, value in enumerate(padded)}
        system, component = self.target or (talk.vehicle_id, 1)
        talk.mark()
        talk.say(
            "COMMAND_LONG",
            target_system=system,
            target_component=component,
            command=self.number,
            **fields,
        )
        check_answers(talk, self.number, self.answers, self.within_s)


@dataclass(frozen=True)
class SetMode:
    """DO_SET_MODE, and its answers: PX4 1.17 says ACCEPTED first and decides then.

    Attributes:
        mode: Name of a `FlightMode`, or main mode and submode.
        result: What is decided.
        base_mode: param1.
        said_twice: False where even 1.17 answers once only.
    """

    mode: str | tuple[int, int]
    result: str = "ACCEPTED"
    base_mode: int = 1

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        main, sub = self.mode if isinstance(self.mode, tuple) else FlightMode[self.mode].value[:2]
        answers = ("ACCEPTED", self.result) if talk.two_answers else (self.result,)
        Command(176, (self.base_mode, main, sub), answers).play(talk)


@dataclass(frozen=True)
class Reposition:
    """DO_REPOSITION as COMMAND_INT.

    Attributes:
        north_m: Local metres; None sends "no position".
        east_m: Local metres.
        up_m: Above home, sent as AMSL; NaN sends NaN; see `raw_z_m`.
        frame: MAV_FRAME that is written on it.
        flags: param2.
        answers: Names of MAV_RESULT.
        raw_z_m: Sent as z as it is.
        latitude_deg: Sent instead of north.
    """

    north_m: float | None
    east_m: float = 0.0
    up_m: float = math.nan
    frame: int = 5
    flags: float = 1.0
    answers: tuple[str, ...] = ("ACCEPTED",)
    raw_z_m: float | None = None
    latitude_deg: float | None = None

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        x = y = NOWHERE
        if self.north_m is not None:
            latitude, longitude = talk.degrees(self.north_m, self.east_m)
            x = round((self.latitude_deg or latitude) * 1e7)
            y = round(longitude * 1e7)
        z_m = self.up_m + talk.ground_amsl_m if self.raw_z_m is None else self.raw_z_m
        talk.mark()
        talk.say(
            "COMMAND_INT",
            target_system=talk.vehicle_id,
            target_component=1,
            command=192,
            frame=self.frame,
            param1=-1.0,
            param2=self.flags,
            param4=math.nan,
            x=x,
            y=y,
            z=z_m,
        )
        check_answers(talk, 192, self.answers, 1.0)


@dataclass(frozen=True)
class Say:
    """Any message; `target_system` and `target_component` are filled in."""

    name: str
    fields: Fields = field(default_factory=dict)
    link: Link = Link.API
    speaker: tuple[int, int] | None = None
    targeted: bool = True

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        target = talk.target if self.targeted else {}
        talk.mark()
        talk.say(self.name, self.link, self.speaker, **(target | self.fields))


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


@dataclass(frozen=True)
class Wait:
    """Let time pass."""

    seconds: float

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        talk.run(self.seconds)


@dataclass(frozen=True)
class Mark:
    """What is expected next has to come from now on."""

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        talk.mark()


@dataclass(frozen=True)
class Beats:
    """Change whose heartbeats are sent: MAV_TYPE, system id, component id; None: nobody's.

    A system id of 0 stands for the vehicle's own.
    """

    who: tuple[int, int, int] | None
    link: Link = Link.API

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        if self.who is None:
            talk.beats.pop(self.link, None)
        else:
            kind, system, component = self.who
            talk.beats[self.link] = (kind, system or talk.vehicle_id, component)


@dataclass(frozen=True)
class Stop:
    """Stop everything that is sent all the time."""

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        talk.streams.clear()


@dataclass(frozen=True)
class Repeat:
    """Send a message all the time, instead of the one before it."""

    name: str
    fields: Fields
    rate_hz: float = 10.0

    def play(self, talk: Talk) -> None:
        """See `Step`."""
        target = talk.target
        if self.name == "MANUAL_CONTROL":
            target = {"target": talk.vehicle_id}
        talk.streams[:] = [Stream(self.name, target | self.fields, 1.0 / self.rate_hz)]


def check_answers(talk: Talk, number: int, answers: tuple[str, ...], within_s: float) -> None:
    """Compare the COMMAND_ACKs to a command with what they are to be."""

    def results() -> list[str]:
        return [
            result_name(heard.fields["result"])
            for heard in talk.since("COMMAND_ACK")
            if heard.fields["command"] == number
        ]

    talk.run(within_s, lambda: bool(answers) and len(results()) >= len(answers))
    talk.run(_EXTRA_S)
    talk.notes.append(f"{number}: {', '.join(results()) or 'silence'}")
    # Of DO_SET_MODE's two answers either may be first when the machine is busy.
    if sorted(results()) != sorted(answers):
        raise DepartureError(
            f"expected command {number} answered {list(answers)}, heard {results()}"
        )


def result_name(result: int) -> str:
    """MAV_RESULT's name without its prefix."""
    return CommandResult(result).name if result in set(CommandResult) else str(result)


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
