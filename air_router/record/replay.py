"""Runs the decisions of a recorded flight again.

The same events at the same times must give the same actions. It replays the controller,
and nothing else: no vehicle, no sockets, no clock. A difference means that the program has changed
since, that the record is not whole, or that a decision depends on something that is not in its
events.
"""

import dataclasses
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from air_router.controller import Controller
from air_router.errors import AirRouterError, ExitCode
from air_router.gossip import Mapper
from air_router.record.channels import ABOUT_MOTIONS, RECENT
from air_router.record.log import Log, RecordEntry
from air_router.record.serialization import decode, plain_of
from air_router.vehicle import Telemetry

CONTEXT: Final = 10
"""Events that are printed before a difference; of positions in between only the last."""

_TOLD: Final = frozenset({"setup", "Reaction", "HomeBy", "LetGo", "Unwritable"})
"""What comes between an event with its actions and the next; all else may come among them."""


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
        replayed: The decisions now; an exception as its text.
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
        for step in self.before:
            yield f"  {step.t:10.3f}  {step.event}"
            yield from (f"              -> {action}" for action in step.actions)
        yield f"  {self.t:10.3f}  {self.event}"
        for label, actions in (("recorded", self.recorded), ("replayed", self.replayed)):
            yield from (f"    {label}: {action}" for action in actions or ["nothing"])

    def as_json(self) -> dict[str, Any]:
        """As plain data; what was before it is for people."""
        return {
            "t": self.t,
            "state": self.state,
            "event": plain_of(self.event),
            "recorded": [*map(plain_of, self.recorded)],
            "replayed": [
                action if isinstance(action, str) else plain_of(action) for action in self.replayed
            ],
        }


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
        return {
            "same": self.difference is None,
            "events": self.events,
            "actions": self.actions,
            "until_s": self.until_s,
            "notes": self.notes,
            "difference": None if self.difference is None else self.difference.as_json(),
        }


class Replayer:
    """Gives a controller the events of a record.

    Args:
        controller: What decides; None: made from the setup in the record.
    """

    def __init__(self, controller: Controller | None = None) -> None:
        self.controller = controller
        self._mapper: Mapper | None = None  # of what the vehicle mapped; None until the setup
        # Recorded motions, and those that were decided now: of several that are alike the
        # controller knows its own, for the object counts.
        self._motions: deque[tuple[Any, Any]] = deque(maxlen=4 * RECENT)

    def prepare(self, entry: RecordEntry) -> None:
        """Take in what the shell did to the controller beside handing it events."""
        if entry.kind == "setup" and self.controller is None:
            self._mapper = Mapper(entry.value.mission)
            self.controller = Controller(entry.value, ground=self._mapper.grid)
        elif entry.kind == "patch" and self._mapper:
            self._mapper.paint(entry.value)
        elif entry.kind == "note" and entry.value.name == "Reaction" and self.controller:
            self.controller.reacts_within(entry.value.fields["reaction_s"])
        elif entry.kind == "note" and entry.value.name == "HomeBy" and self.controller:
            self.controller.home_by(entry.value.fields["home_by_s"])

    def decide(self, step: RecordedStep) -> list[Any]:
        """What the controller decides now on what happened.

        Raises:
            ReplayError: there is no controller yet.
        """
        if self.controller is None:
            raise ReplayError("there is no setup before the first event: it cannot be replayed")
        event = step.event
        if isinstance(event, ABOUT_MOTIONS):
            own = (own for recorded, own in self._motions if recorded is event.action)
            event = dataclasses.replace(event, action=next(own, event.action))
        decided = list(self.controller.handle(event, step.t))
        self._motions.extend(zip(step.actions, decided, strict=False))
        return decided


def steps_of(entries: Iterable[RecordEntry]) -> Iterator[RecordEntry | RecordedStep]:
    """Events with their actions, and all else that is recorded, in order.

    Events after the vehicle was released are not in it. The last event of a record
    that was cut off is left out: not all that followed may be there. What was painted into the map
    after an event comes after it, whatever actions the event has.
    """
    current: RecordedStep | None = None
    patches: list[RecordEntry] = []  # painted since
    left = False
    for entry in entries:
        name = entry.value.name if entry.kind == "note" else entry.kind
        if name == "action":
            if current is not None:
                current.actions.append(entry.value)
        elif not (left and name in {"event", *_TOLD}):
            if current is not None and name in {"event", *_TOLD}:
                yield current
                current = None
                yield from patches
                patches.clear()
            if name == "event":
                current = RecordedStep(entry.t, entry.value, [])
            elif name == "patch" and current is not None:
                patches.append(entry)
            else:
                left = left or name == "LetGo"
                yield entry
    cut = isinstance(entries, Log) and entries.ending is not None
    if current is not None and not cut:
        yield current


def replay_record(entries: Iterable[RecordEntry], controller: Controller | None = None) -> Replay:
    """Give a record's events to a fresh controller and compare what it does.

    Args:
        entries: The record.
        controller: What decides; None: made from the setup in the record.

    Raises:
        ReplayError: there is no setup in the record, or no decision to compare with.
        LogError: see `air_router.record.log`.
    """
    result, replayer = Replay(), Replayer(controller)
    before: deque[RecordedStep] = deque(maxlen=CONTEXT)
    for step in steps_of(entries):
        if isinstance(step, RecordEntry):
            replayer.prepare(step)
            if step.kind == "note" and step.value.name == "Unwritable":
                lost = f"at {step.t:.3f} s something could not be recorded: {step.value.fields}"
                result.notes.append(lost)
            continue
        result.events += 1
        result.actions += len(step.actions)
        result.until_s = step.t
        try:
            decided = replayer.decide(step)
        except ReplayError:
            raise
        except Exception as error:  # noqa: BLE001 - a flight that ended so does it again
            decided = [f"{type(error).__name__}: {error}"]
        # Numbers are the same when every bit is; NaN is NaN, and 1 is 1.0 as in the record.
        if [*map(_as_recorded, decided)] != [*map(repr, step.actions)]:
            assert replayer.controller is not None  # noqa: S101 - it has decided
            state = replayer.controller.status().state.name
            result.difference = ReplayDifference(
                step.t, step.event, step.actions, decided, state, tuple(before)
            )
            return result
        if before and isinstance(before[-1].event, Telemetry) and not before[-1].actions:
            before.pop()
        before.append(step)
    if not result.actions:
        cut = entries.ending if isinstance(entries, Log) else None
        why = f": {cut}" if cut else ""
        raise ReplayError(f"no decision was recorded, so there is nothing to compare{why}")
    return result


def _as_recorded(action: object) -> str:
    """An action as text, as it would be read from a record."""
    try:
        return repr(decode(plain_of(action)))
    except TypeError:  # an exception as its text
        return repr(action)
