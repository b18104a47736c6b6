"""The scripted conversations: what they are made of, and how they are held with a vehicle.

A file of `cases/` maps the name of each case to a list. First comes where the vehicle is when it
starts, with PX4's fact, in brackets where that was recorded, and settings of a `Conversation` if it
needs some; then its steps. A list within the list stands for its steps: `definitions` holds what
several cases share.

A step is a mapping. Its first entry is a verb and what it is about; the others are named terms of
the function of `sending` or `expecting` that is called as the verb is:

    {mode: AUTO_LOITER, armed: true}  ->  expecting.mode(session, "AUTO_LOITER", armed=True)

The steps are those of PX4 1.17. Where another version differs, a step has a term for it:

    {set mode: [99, 0], since 1.18: {result: TEMPORARILY_REJECTED, because: ...}}   other terms
    {text: Operation timeout, before 1.17: {left out: why}}                         no such step
"""

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from importlib.resources import files
from typing import Any, Final

import yaml

from air_router.vehicle.px4 import NEWEST, Version, version_of
from sitl.conformance import expecting, sending
from sitl.conformance.session import DepartureError, Line, LinkKind, Session, SilentVehicleError

_READY: Final = 0x10000000  # SYS_STATUS: pre-arm check
_READY_S: Final = 60.0
_AUTOPILOT_VERSION: Final = 148  # message
_ATTEMPTS: Final = 10

Step = Mapping[str, Any]

VERBS: Final[Mapping[str, Callable[..., None]]] = {
    name.replace("_", " "): step
    for module in (sending, expecting)
    for name, step in vars(module).items()
    if callable(step) and step.__module__ == module.__name__ and not name.startswith("_")
    if "session" in inspect.signature(step).parameters
}


def run_steps(session: Session, steps: Iterable[Step]) -> None:
    """Send and expect, step by step.

    Raises:
        DepartureError: the vehicle did something else; the message begins with the step.
        SilentVehicleError: it has fallen silent; the message begins with the step.
    """
    for each in steps:
        step = in_version(each, session.version)
        if step is None:
            continue
        (verb, about), *terms = step.items()
        try:
            VERBS[verb](session, about, **dict(terms))
        except (DepartureError, SilentVehicleError) as error:
            raise type(error)(f"{verb} {'' if about is None else about}: {error}") from None


LEFT_OUT: Final = "left out"
BECAUSE: Final = "because"


def in_version(step: Step, version: Version) -> Step | None:
    """A step of one version of PX4; None: it is left out there."""
    terms: dict[str, Any] = {}
    for key, value in step.items():
        holds = _holds(key, version)
        if holds is None:
            terms[key] = value
        elif holds and LEFT_OUT in value:
            return None
        elif holds:
            terms |= {name: term for name, term in value.items() if name != BECAUSE}
    return terms


def _holds(key: str, version: Version) -> bool | None:
    """Whether a term such as `since 1.18` or `before 1.17` holds; None: it is another term."""
    when, _, number = key.partition(" ")
    limit = version_of(number)
    if limit is None or when not in {"since", "before"}:
        return None
    return version >= limit if when == "since" else version < limit


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
        name: Lower case, with hyphens.
        fact: What PX4 1.17 does.
        recorded: Where that was recorded: a scripted session with PX4 1.17.0 and the second in it,
            or the rule that was measured or read in its source.
        steps: What to send and to expect.
        start: How the vehicle is before.
        parameters: Set before it begins.
        started_with: Parameters that are on board when it starts: what counts only then.
        links: That it needs.
        since: First version of PX4 that it is run on; None: all.
        before: First version that it is no longer run on; None: all since.
    """

    name: str
    fact: str
    recorded: str
    steps: tuple[Step, ...]
    start: Start = Start.GROUND
    parameters: Mapping[str, float] = field(default_factory=dict)
    started_with: Mapping[str, float] = field(default_factory=dict)
    links: frozenset[LinkKind] = frozenset({LinkKind.API})
    since: Version | None = None
    before: Version | None = None

    def is_held_with(self, version: Version) -> bool:
        """Whether it is for a PX4 of this version."""
        return (self.since is None or self.since <= version) and (
            self.before is None or version < self.before
        )


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


def converse(conversation: Conversation, line: Line, version: Version) -> Outcome:
    """Hold one conversation with a vehicle of a version that was started for it."""
    session = Session(line, version)
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


def reported_version(line: Line) -> Version:
    """The version that a vehicle reports on request (REQUEST_MESSAGE)."""
    session = Session(line, NEWEST)
    session.run(_READY_S, lambda: session.newest("HEARTBEAT") is not None)
    for _ in range(_ATTEMPTS):
        session.send("COMMAND_LONG", command="REQUEST_MESSAGE", param1=_AUTOPILOT_VERSION)
        if session.run(1.0, lambda: session.newest("AUTOPILOT_VERSION") is not None):
            break
    found = session.newest("AUTOPILOT_VERSION")
    if found is None:
        raise SilentVehicleError("the vehicle does not report its version")
    number = found["flight_sw_version"]
    return number >> 24 & 0xFF, number >> 16 & 0xFF


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
    (where, described), *settings = start.items()
    fact, _, recorded = described.removesuffix(")").rpartition(" (")
    terms: dict[str, Any] = dict(settings)
    terms["links"] = frozenset(map(LinkKind, terms.get("links", [LinkKind.API])))
    terms |= {each: version_of(str(terms[each])) for each in ("since", "before") if each in terms}
    return Conversation(name, fact, recorded, tuple(_flat(steps)), Start(where), **terms)


def _flat(entries: Any) -> Iterator[Step]:
    for entry in entries:
        if isinstance(entry, list):
            yield from _flat(entry)
        else:
            yield {entry: None} if isinstance(entry, str) else entry
