"""The scripted conversations: what they are made of, and how they are held with a vehicle.

A file of `cases/` maps the name of each case to a list. First comes where the vehicle is when it
starts, with PX4's fact, in brackets where that was recorded, and settings of a `Conversation` if it
needs some; then its steps. A list within the list stands for its steps: `definitions` holds what
several cases share.

A step is a mapping. Its first entry is a verb and what it is about; the others are named terms of
the function of `sending` or `expecting` that is called as the verb is:

    {mode: AUTO_LOITER, armed: true}  ->  expecting.mode(session, "AUTO_LOITER", armed=True)
"""

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from importlib.resources import files
from typing import Any, Final

import yaml

from sitl.conformance import expecting, sending
from sitl.conformance.session import DepartureError, Line, Link, Session, SilentVehicleError

_READY: Final = 0x10000000  # SYS_STATUS: pre-arm check
_READY_S: Final = 60.0

Step = Mapping[str, Any]

VERBS: Final[Mapping[str, Callable[..., None]]] = {
    name.replace("_", " "): step
    for module in (sending, expecting)
    for name, step in vars(module).items()
    if callable(step) and step.__module__ == module.__name__ and not name.startswith("_")
    if "session" in inspect.signature(step).parameters
}


def run_steps(session: Session, steps: Iterable[Step]) -> None:
    """Say and expect what the steps say.

    Raises:
        DepartureError: the vehicle did something else; the message begins with the step.
        SilentVehicleError: it says nothing any more; likewise.
    """
    for step in steps:
        (verb, about), *terms = step.items()
        try:
            VERBS[verb](session, about, **dict(terms))
        except (DepartureError, SilentVehicleError) as error:
            raise type(error)(f"{verb} {'' if about is None else about}: {error}") from None


_TO_THE_AIR: Final[tuple[Step, ...]] = (
    {"command": "COMPONENT_ARM_DISARM", "params": (1,)},
    {"take off": 15.0},
    {"mode": "AUTO_TAKEOFF"},
    {"mode": "AUTO_LOITER", "within_s": 35.0},
    {"wait": 3.0},
)


class Start(Enum):
    """How the vehicle is when a conversation begins."""

    BOOT = "just started"
    GROUND = "on the ground"  # ready to arm
    AIR = "in the air"  # hovers in Hold, 15 m above home


@dataclass(frozen=True)
class Conversation:
    """A script.

    Attributes:
        name: In words with hyphens.
        fact: What PX4 1.17 does.
        recorded: Where that was recorded: a scripted session with PX4 1.17.0 and the second in it,
            or the rule that was measured or read in its source.
        steps: What is said and expected.
        start: How the vehicle is before.
        parameters: Set before it begins.
        links: That it needs.
    """

    name: str
    fact: str
    recorded: str
    steps: tuple[Step, ...]
    start: Start = Start.GROUND
    parameters: Mapping[str, float] = field(default_factory=dict)
    links: frozenset[Link] = frozenset({Link.API})


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a conversation ended.

    Attributes:
        name: Of the conversation.
        held: Whether the vehicle did all that is written.
        departure: What it did else.
        notes: What was seen.
        took_s: Vehicle's time.
    """

    name: str
    held: bool
    departure: str = ""
    notes: tuple[str, ...] = ()
    took_s: float = 0.0


def converse(conversation: Conversation, line: Line) -> Outcome:
    """Hold one conversation with a vehicle that was started for it."""
    session = Session(line)
    when = "before it: "
    try:
        prepare(conversation, session)
        session.notes.clear()
        begun_s, when = session.now_s, ""
        run_steps(session, conversation.steps)
    except (DepartureError, SilentVehicleError) as error:
        notes = tuple(session.notes)
        return Outcome(conversation.name, held=False, departure=f"{when}{error}", notes=notes)
    took_s = session.now_s - begun_s
    return Outcome(conversation.name, held=True, notes=tuple(session.notes), took_s=took_s)


def prepare(conversation: Conversation, session: Session) -> None:
    """Bring a vehicle that was just started to the start of a conversation."""
    if conversation.start is Start.BOOT:
        return
    _wait_ready(session)
    for name, value in conversation.parameters.items():
        sending.set_parameter(session, name, value, answers=None)
    if conversation.start is Start.AIR:
        run_steps(session, _TO_THE_AIR)


def _wait_ready(session: Session) -> None:
    def ready() -> bool:
        status = session.newest("SYS_STATUS")
        known = session.newest("HOME_POSITION") is not None and bool(session.track)
        return bool(known and status and status["onboard_control_sensors_health"] & _READY)

    if not session.run(_READY_S, ready):
        raise DepartureError(f"not ready to arm within {_READY_S:g} s")
    session.run(1.0)


@cache
def conversations() -> tuple[Conversation, ...]:
    """All of them, in the order of their files."""
    cases = sorted((files("sitl.conformance") / "cases").iterdir(), key=lambda file: file.name)
    return tuple(case for file in cases for case in cases_of(file.read_text("utf-8")))


def cases_of(text: str) -> Iterator[Conversation]:
    """The conversations of one file."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # five times as fast, where it is built
    for name, case in yaml.load(text, loader).items():  # noqa: S506 - safe
        if name != "definitions":
            yield _conversation(name, *case)


def _conversation(name: str, start: dict[str, Any], *steps: Any) -> Conversation:
    (where, said), *settings = start.items()
    fact, _, recorded = said.removesuffix(")").rpartition(" (")
    terms: dict[str, Any] = dict(settings)
    terms["links"] = frozenset(map(Link, terms.get("links", [Link.API])))
    return Conversation(name, fact, recorded, tuple(_flat(steps)), Start(where), **terms)


def _flat(entries: Any) -> Iterator[Step]:
    for entry in entries:
        if isinstance(entry, list):
            yield from _flat(entry)
        else:
            yield {entry: None} if isinstance(entry, str) else entry
