"""One scripted conversation, and what became of it; all of them, and two runs side by side.

A file of `cases/` maps the name of each case to a list. First comes where the vehicle is when it
starts, with PX4's fact, in brackets where that was recorded, and settings of a `Conversation` if it
needs some; then its steps (see `interpreter`). A list within the list stands for its steps:
`definitions` holds what several cases share.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from importlib.resources import files
from itertools import zip_longest
from typing import Any, Final

import yaml

from sitl.conformance.expecting import disarmed, same
from sitl.conformance.interpreter import Step, run_steps
from sitl.conformance.line import Line, Link, SilentVehicleError
from sitl.conformance.session import GROUND_STATION, DepartureError, Session
from sitl.conformance.transfers import KINDS, clear, read_parameter, set_parameter
from sitl.px4sim.state.px4_modes import FlightMode

_READY: int = 0x10000000  # SYS_STATUS: pre-arm check
_READY_S: float = 60.0
_HEARD_S: float = 10.0
_LANDED_S: float = 120.0
_SETTLE_S: float = 1.5
_VERSION: int = 148  # AUTOPILOT_VERSION
_TO_THE_AIR: tuple[Step, ...] = (
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
        fact: What PX4 does.
        recorded: Where that was recorded: a scripted session with PX4 1.17.0 and the second in it,
            or the rule that was measured or read in its source.
        steps: What is said and expected.
        start: How the vehicle is before.
        parameters: Set before it begins.
        links: That it needs.
        until: The last PX4 that does so: 1, 17; None: no end is known.
        since: The first PX4 that does so.
    """

    name: str
    fact: str
    recorded: str
    steps: tuple[Step, ...]
    start: Start = Start.GROUND
    parameters: Mapping[str, float] = field(default_factory=dict)
    links: frozenset[Link] = frozenset({Link.API})
    until: Sequence[int] | None = None
    since: Sequence[int] | None = None


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
    session = Session(line)
    when = "before it: "
    before: dict[str, float] = {}
    try:
        unfit = _prepare(conversation, session, before)
        if unfit:
            return Outcome(conversation.name, held=False, departure=unfit, left_out=True)
        session.notes.clear()
        begun_s, when = session.now_s, ""
        run_steps(session, conversation.steps)
        took_s, notes = session.now_s - begun_s, tuple(session.notes)
        when = "after it: "
        if not line.fresh:
            tidy(session, before)
    except (DepartureError, SilentVehicleError) as error:
        return Outcome(
            conversation.name, held=False, departure=f"{when}{error}", notes=tuple(session.notes)
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


def _prepare(conversation: Conversation, session: Session, before: dict[str, float]) -> str:
    """Bring the vehicle to the start; why it cannot be used, if so.

    `before` is filled with the values that the parameters had.
    """
    if conversation.start is Start.BOOT:
        return "" if session.line.fresh else "needs a vehicle that was just started"
    if not session.line.fresh:
        tidy(session, {})
    _wait_ready(session)
    version = _version(session)
    session.two_answers = version <= (1, 17)
    if conversation.until is not None and version > tuple(conversation.until):
        return f"only up to PX4 {_words(conversation.until)}"
    if conversation.since is not None and version < tuple(conversation.since):
        return f"only from PX4 {_words(conversation.since)} on"
    for name, value in conversation.parameters.items():
        if not session.line.fresh:
            before[name] = read_parameter(session, name)
        _set(session, name, value)
    if conversation.start is Start.AIR:
        run_steps(session, _TO_THE_AIR)
    return ""


def tidy(session: Session, parameters: Mapping[str, float]) -> None:
    """Bring a vehicle back: on the ground, disarmed, in Hold, without a plan.

    Args:
        session: With the vehicle.
        parameters: To be set back.
    """
    session.streams.clear()
    session.beats = {Link.API: GROUND_STATION, Link.GROUND: GROUND_STATION}
    session.mark()
    if not session.run(_HEARD_S, lambda: session.newest("HEARTBEAT") is not None):
        raise DepartureError("no HEARTBEAT")
    if same(session.newest("HEARTBEAT") or {}, {"armed": True}):
        _ask_mode(session, "AUTO_LAND")
        disarmed(session, (0.0, _LANDED_S))
    _ask_mode(session, "AUTO_LOITER")
    for kind in KINDS:
        clear(session, kind)
    for name, value in parameters.items():
        _set(session, name, value)


def _ask_mode(session: Session, name: str) -> None:
    main, sub = FlightMode[name].value[:2]
    session.say("COMMAND_LONG", command="DO_SET_MODE", param1=1.0, param2=main, param3=sub)
    session.run(_SETTLE_S)


def _wait_ready(session: Session) -> None:
    def ready() -> bool:
        status = session.newest("SYS_STATUS")
        beat = session.newest("HEARTBEAT")
        known = session.newest("HOME_POSITION") is not None and bool(session.track)
        return bool(known and status and beat and status["onboard_control_sensors_health"] & _READY)

    if not session.run(_READY_S, ready):
        raise DepartureError(f"not ready to arm within {_READY_S:g} s")
    session.run(1.0)


def _version(session: Session) -> tuple[int, int]:
    session.mark()
    session.say("COMMAND_LONG", command="REQUEST_MESSAGE", param1=_VERSION)
    session.run(2.0, lambda: bool(session.since("AUTOPILOT_VERSION")))
    session.run(2.0, lambda: bool(session.since("COMMAND_ACK")))
    version = session.newest("AUTOPILOT_VERSION")
    if version is None:
        raise DepartureError("expected AUTOPILOT_VERSION, heard none")
    number = version["flight_sw_version"]
    return number >> 24 & 0xFF, number >> 16 & 0xFF


def _set(session: Session, name: str, value: float) -> None:
    for answers in (2, 1):
        try:
            set_parameter(session, name, value, answers)
        except DepartureError:
            if answers == 1:
                raise
        else:
            return


def _words(version: Sequence[int]) -> str:
    return f"{version[0]}.{version[1]}"


_FILES: Final = (
    *("commands", "modes", "missions", "flown_missions"),
    *("fences", "offboard", "links", "failsafes"),
)


@cache
def conversations() -> tuple[Conversation, ...]:
    """All of them, in the order of their files."""
    folder = files("sitl.conformance") / "cases"
    texts = ((folder / f"{file}.yaml").read_text("utf-8") for file in _FILES)
    return tuple(case for text in texts for case in cases_of(text))


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


def beside(
    conversations: Iterable[Conversation], ours: Iterable[Outcome], theirs: Iterable[Outcome]
) -> str:
    """The table: every conversation, its fact, how each run ended and what was seen differently."""
    by_name = {outcome.name: outcome for outcome in theirs}
    own = {outcome.name: outcome for outcome in ours}
    lines = [
        "| conversation | fact (recorded in) | ours | PX4 | seen otherwise: ours / PX4 |",
        "|---|---|---|---|---|",
    ]
    for conversation in conversations:
        mine, other = own[conversation.name], by_name.get(conversation.name)
        cells = (
            conversation.name,
            f"{conversation.fact} ({conversation.recorded})",
            _word(mine),
            "not held" if other is None else _word(other),
            _differences(mine, other),
        )
        lines.append(f"| {' | '.join(_cell(text) for text in cells)} |")
    return "\n".join(lines)


def _word(outcome: Outcome) -> str:
    if outcome.held:
        return "held"
    return f"{'left out' if outcome.left_out else '**departs**'}: {outcome.departure}"


def _differences(mine: Outcome, other: Outcome | None) -> str:
    if other is None:
        return "; ".join(mine.notes)
    pairs = zip_longest(mine.notes, other.notes, fillvalue="nothing")
    return "; ".join(f"{one} / {two}" for one, two in pairs if one != two)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
