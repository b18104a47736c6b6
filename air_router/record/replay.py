"""Runs the decisions of a recorded flight again.

The same events at the same times must give the same actions. What is replayed is the controller,
and nothing else: no vehicle, no sockets, no clock. A difference means that the program has changed
since, that the record is not whole, or that a decision depends on something that is not in its
events.
"""

import dataclasses
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from air_router.controller.controller import Controller
from air_router.controller.model.events import CommandConfirmed, CommandFailed
from air_router.errors import AirRouterError, ExitCode
from air_router.record import serialization
from air_router.record.log import Log, Note, RecordEntry
from air_router.record.log_file import RECENT
from air_router.vehicle.vehicle import Telemetry

CONTEXT: Final = 10
"""So many events before a difference are told; positions in between only as the last one."""


class ReplayError(AirRouterError):
    """A record in which there is nothing to replay."""

    exit_code = ExitCode.INVALID_FILE


class RecordedStep(NamedTuple):
    """An event with the actions that followed."""

    t: float
    event: Any
    actions: list[Any]


@dataclass(frozen=True, slots=True)
class ReplayDifference:
    """Where a replay first decides otherwise.

    Attributes:
        t: On the vehicle's clock.
        event: What happened.
        recorded: What was decided in flight.
        replayed: What is decided now; an exception as its text.
        state: The state of the mission then, in the replay.
        before: The events before it.
    """

    t: float
    event: Any
    recorded: list[Any]
    replayed: list[Any]
    state: str
    before: tuple[RecordedStep, ...]

    def lines(self) -> Iterator[str]:
        """As text."""
        yield f"first difference at {self.t:.3f} s, in {self.state}:"
        for told in self.before:
            yield f"  {told.t:10.3f}  {told.event}"
            yield from (f"              -> {action}" for action in told.actions)
        yield f"  {self.t:10.3f}  {self.event}"
        for word, actions in (("recorded", self.recorded), ("replayed", self.replayed)):
            if not actions:
                yield f"    {word}: nothing"
            yield from (f"    {word}: {action}" for action in actions)


@dataclass(slots=True)
class Replay:
    """What came of it."""

    events: int = 0  # number taken in
    actions: int = 0  # number decided
    until_s: float = 0.0  # of the last event, vehicle's clock
    difference: ReplayDifference | None = None
    notes: list[str] = field(default_factory=list)  # why it may be incomplete

    def as_json(self) -> dict[str, Any]:
        """As plain data."""
        found = self.difference
        return {
            "same": found is None,
            "events": self.events,
            "actions": self.actions,
            "until_s": self.until_s,
            "notes": self.notes,
            "difference": None
            if found is None
            else {
                "t": found.t,
                "state": found.state,
                "event": serialization.encode(found.event),
                "recorded": [_plain(action) for action in found.recorded],
                "replayed": [_plain(action) for action in found.replayed],
            },
        }


def replay(entries: Iterable[RecordEntry], controller: Controller | None = None) -> Replay:
    """Give a record's events to a fresh controller and compare what it does.

    Args:
        entries: The record.
        controller: What decides; None: made from the setup in the record.

    Raises:
        ReplayError: there is no setup in the record, or no decision to compare with.
        LogError: see `air_router.record.log`.
    """
    result = Replay()
    before: deque[RecordedStep] = deque(maxlen=CONTEXT)
    motions: deque[tuple[Any, Any]] = deque(maxlen=4 * RECENT)
    for step in _steps(entries):
        if isinstance(step, RecordEntry):
            controller = _prepared(step, controller, result)
            continue
        if controller is None:
            raise ReplayError("there is no setup before the first event: it cannot be replayed")
        result.events += 1
        result.actions += len(step.actions)
        result.until_s = step.t
        decided = _decide(controller, step, motions)
        if [*map(_comparable, decided)] != [*map(_comparable, step.actions)]:
            state = controller.state.name
            result.difference = ReplayDifference(
                step.t, step.event, step.actions, decided, state, tuple(before)
            )
            return result
        motions.extend(zip(step.actions, decided, strict=True))
        if before and isinstance(before[-1].event, Telemetry) and not before[-1].actions:
            before.pop()
        before.append(step)
    if not result.actions:
        cut = entries.ending if isinstance(entries, Log) else None
        why = f": {cut}" if cut else ""
        raise ReplayError(f"no decision was recorded, so there is nothing to compare{why}")
    return result


def _steps(entries: Iterable[RecordEntry]) -> Iterator[RecordEntry | RecordedStep]:
    """Events with their actions, and what else the controller was told, up to where it was left.

    The last event of a record that was cut off is left out: not all that followed may be there.
    """
    current: RecordedStep | None = None
    for entry in entries:
        if entry.kind == "action" and current is not None:
            current.actions.append(entry.value)
            continue
        if entry.kind not in {"event", "setup", "note"}:
            continue
        if entry.kind == "note" and entry.value.name not in {"Reaction", "LetGo", "Unwritable"}:
            continue
        if current is not None:
            yield current
            current = None
        if entry.kind == "event":
            current = RecordedStep(entry.t, entry.value, [])
        elif entry.kind == "note" and entry.value.name == "LetGo":
            return
        else:
            yield entry
    cut = isinstance(entries, Log) and entries.ending is not None
    if current is not None and not cut:
        yield current


def _prepared(
    entry: RecordEntry, controller: Controller | None, result: Replay
) -> Controller | None:
    """What the shell did to the controller beside handing it events."""
    if entry.kind == "setup":
        return controller if controller is not None else entry.value.controller()
    note: Note = entry.value
    if note.name == "Unwritable":
        result.notes.append(f"at {entry.t:.3f} s something could not be recorded: {note.fields}")
    elif controller is not None:
        controller.navigator.reaction_s = note.fields["reaction_s"]
    return controller


def about_own(event: Any, motions: Iterable[tuple[Any, Any]]) -> Any:
    """The event, but about the motion that was decided now; `motions`: (recorded, decided now).

    Of motions that are alike the controller knows its own: the object counts.
    """
    if isinstance(event, CommandConfirmed | CommandFailed):
        for recorded, own in motions:
            if recorded is event.action:
                return dataclasses.replace(event, action=own)
    return event


def _decide(
    controller: Controller, step: RecordedStep, motions: Iterable[tuple[Any, Any]]
) -> list[Any]:
    try:
        return list(controller.handle(about_own(step.event, motions), step.t))
    except Exception as error:  # noqa: BLE001 - a flight that ended so does it again
        return [f"{type(error).__name__}: {error}"]


def _comparable(action: Any) -> str:
    """Numbers are the same when every bit is; NaN is NaN."""
    return repr(action)


def _plain(action: Any) -> Any:
    return action if isinstance(action, str) else serialization.encode(action)
