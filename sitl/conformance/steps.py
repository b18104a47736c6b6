"""What a conversation is made of: what is said, and waits; `expectations` are the rest."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

from sitl.conformance.line import Link
from sitl.conformance.talk import DepartureError, Stream, Talk
from sitl.px4sim.commands import CommandResult
from sitl.px4sim.state.px4_modes import FlightMode

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
