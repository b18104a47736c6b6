"""One scripted conversation, and what became of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

from sitl.conformance.flight_steps import Disarmed, TakeOff
from sitl.conformance.line import Line, Link, SilentVehicleError
from sitl.conformance.parameter_steps import SetParameter, read_value
from sitl.conformance.plan_steps import ClearAll
from sitl.conformance.steps import Step
from sitl.conformance.talk import GROUND_STATION, DepartureError, Talk
from sitl.px4sim.state.px4_modes import FlightMode

_READY: int = 0x10000000  # SYS_STATUS: pre-arm check
_READY_S: float = 60.0
_HEARD_S: float = 10.0
_LANDED_S: float = 120.0
_SETTLE_S: float = 1.5
_ARMED: int = 128


class Start(Enum):
    """How the vehicle is when a conversation begins."""

    BOOT = "just started"
    GROUND = "on the ground, ready to arm"
    AIR = "hovers in Hold, 15 m above home"


@dataclass(frozen=True)
class Conversation:
    """A script.

    Attributes:
        name: In words with hyphens.
        fact: What PX4 does.
        recorded: Where that was recorded: a scripted session with PX4 1.17.0 and the second in it,
            or the rule that was measured or read in its source.
        steps: What is said and expected.
        start: How the vehicle is before.
        parameters: Set before it begins.
        links: That it needs.
        until: The last PX4 that does so: (1, 17); None: no end is known.
        since: The first PX4 that does so.
    """

    name: str
    fact: str
    recorded: str
    steps: tuple[Step, ...]
    start: Start = Start.GROUND
    parameters: Mapping[str, float] = field(default_factory=dict)
    links: frozenset[Link] = frozenset({Link.API})
    until: tuple[int, int] | None = None
    since: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a conversation ended.

    Attributes:
        name: Of the conversation.
        held: Whether the vehicle did all that is written.
        departure: What it did else; for one that was left out, why.
        notes: What was seen.
        took_s: Vehicle's time.
        left_out: Whether it was not held at all.
    """

    name: str
    held: bool
    departure: str = ""
    notes: tuple[str, ...] = ()
    took_s: float = 0.0
    left_out: bool = False


def converse(conversation: Conversation, line: Line) -> Outcome:
    """Hold one conversation; a vehicle that was not started for it is brought back afterwards."""
    missing = conversation.links - line.links
    if missing:
        names = ", ".join(link.value for link in missing)
        return Outcome(conversation.name, held=False, departure=f"no {names} link", left_out=True)
    talk = Talk(line)
    step: Step | None = None
    before: dict[str, float] = {}
    try:
        unfit = _prepare(conversation, talk, before)
        if unfit:
            return Outcome(conversation.name, held=False, departure=unfit, left_out=True)
        talk.notes.clear()
        begun_s = talk.now_s
        for step in conversation.steps:
            step.play(talk)
        took_s, notes = talk.now_s - begun_s, tuple(talk.notes)
        step = None
        if not line.fresh:
            tidy(talk, before)
    except (DepartureError, SilentVehicleError) as error:
        at = f"{type(step).__name__}: " if step is not None else "before or after it: "
        return Outcome(
            conversation.name, held=False, departure=f"{at}{error}", notes=tuple(talk.notes)
        )
    return Outcome(conversation.name, held=True, notes=notes, took_s=took_s)


def converse_all(
    conversations: tuple[Conversation, ...],
    dial: Callable[[Conversation], Line],
    tell: Callable[[Outcome], None],
) -> list[Outcome]:
    """Hold conversations one after the other.

    Args:
        conversations: Which.
        dial: Gets a line to a vehicle for one; it is closed afterwards.
        tell: Called with every outcome.
    """
    outcomes = []
    for conversation in conversations:
        line = dial(conversation)
        try:
            outcome = converse(conversation, line)
        finally:
            line.close()
        tell(outcome)
        outcomes.append(outcome)
    return outcomes


def _prepare(conversation: Conversation, talk: Talk, before: dict[str, float]) -> str:
    """Bring the vehicle to the start; why it cannot be used, if so.

    `before` is filled with the values that the parameters had.
    """
    if conversation.start is Start.BOOT:
        return "" if talk.line.fresh else "needs a vehicle that was just started"
    if not talk.line.fresh:
        tidy(talk, {})
    _wait_ready(talk)
    version = _version(talk)
    talk.two_answers = version <= (1, 17)
    if conversation.until is not None and version > conversation.until:
        return f"only up to PX4 {_words(conversation.until)}"
    if conversation.since is not None and version < conversation.since:
        return f"only from PX4 {_words(conversation.since)} on"
    for name, value in conversation.parameters.items():
        if not talk.line.fresh:
            before[name] = read_value(talk, name)
        _set(talk, name, value)
    if conversation.start is Start.AIR:
        TakeOff().play(talk)
    return ""


def tidy(talk: Talk, parameters: Mapping[str, float]) -> None:
    """Bring a vehicle back: on the ground, disarmed, in Hold, without a plan.

    Args:
        talk: With the vehicle.
        parameters: To be set back.
    """
    talk.streams.clear()
    talk.beats = {Link.API: GROUND_STATION, Link.GROUND: GROUND_STATION}
    talk.mark()
    if not talk.run(_HEARD_S, lambda: talk.newest("HEARTBEAT") is not None):
        raise DepartureError("no HEARTBEAT")
    beat = talk.newest("HEARTBEAT") or {}
    if beat["base_mode"] & _ARMED:
        _ask_mode(talk, "AUTO_LAND")
        Disarmed(_LANDED_S).play(talk)
    _ask_mode(talk, "AUTO_LOITER")
    for kind in (0, 1, 2):
        ClearAll(kind).play(talk)
    for name, value in parameters.items():
        _set(talk, name, value)


def _ask_mode(talk: Talk, name: str) -> None:
    main, sub = FlightMode[name].value[:2]
    fields = {"param1": 1.0, "param2": float(main), "param3": float(sub), "command": 176}
    talk.say("COMMAND_LONG", **(talk.target | fields))
    talk.run(_SETTLE_S)


def _wait_ready(talk: Talk) -> None:
    def ready() -> bool:
        status = talk.newest("SYS_STATUS")
        beat = talk.newest("HEARTBEAT")
        known = talk.newest("HOME_POSITION") is not None and bool(talk.track)
        return bool(known and status and beat and status["onboard_control_sensors_health"] & _READY)

    if not talk.run(_READY_S, ready):
        raise DepartureError(f"not ready to arm within {_READY_S:g} s")
    talk.run(1.0)


def _version(talk: Talk) -> tuple[int, int]:
    talk.mark()
    talk.say(
        "COMMAND_LONG",
        target_system=talk.vehicle_id,
        target_component=1,
        command=512,
        param1=148,
    )
    talk.run(2.0, lambda: bool(talk.since("AUTOPILOT_VERSION")))
    talk.run(2.0, lambda: bool(talk.since("COMMAND_ACK")))
    version = talk.newest("AUTOPILOT_VERSION")
    if version is None:
        raise DepartureError("expected AUTOPILOT_VERSION, heard none")
    number = version["flight_sw_version"]
    return number >> 24 & 0xFF, number >> 16 & 0xFF


def _set(talk: Talk, name: str, value: float) -> None:
    for answers in (2, 1):
        try:
            SetParameter(name, value, answers).play(talk)
        except DepartureError:
            if answers == 1:
                raise
        else:
            return


def _words(version: tuple[int, int]) -> str:
    return f"{version[0]}.{version[1]}"
