"""Runs the decisions of a recorded flight again.

The same events at the same times must give the same actions. Only the controller is replayed: no
vehicle, no sockets, no clock. A difference means that the program has changed since, that the
record is incomplete, or that a decision depends on data outside its events.
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
"""Number of events printed before a difference; of consecutive positions only the last."""

_TOLD: Final = frozenset({"setup", "Reaction", "HomeBy", "LetGo", "Unwritable"})
"""Entries that end an event's list of actions; all others may occur within it."""


class ReplayError(AirRouterError):
    """The record has nothing to replay."""

    exit_code = ExitCode.INVALID_FILE


class RecordedStep(NamedTuple):
    """An event with the actions that followed."""

    t: float
    event: Any
    actions: list[Any]


@dataclass(frozen=True, slots=True)
class ReplayDifference:
    """The first difference of a replay.

    Attributes:
        t: Time on the vehicle's clock.
        event: The event.
        recorded: The actions decided in flight.
        replayed: The actions decided now; an exception as its text.
        state: The mission's state in the replay.
        before: The preceding events.
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
        """The difference as plain data, without the preceding events."""
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
    """The result of a replay."""

    events: int = 0  # number of events
    actions: int = 0  # number of actions
    until_s: float = 0.0  # time of the last event, vehicle's clock
    difference: ReplayDifference | None = None
    notes: list[str] = field(default_factory=list)  # why it may be incomplete

    def as_json(self) -> dict[str, Any]:
        """The result as plain data."""
        return {
            "same": self.difference is None,
            "events": self.events,
            "actions": self.actions,
            "until_s": self.until_s,
            "notes": self.notes,
            "difference": None if self.difference is None else self.difference.as_json(),
        }


class Replayer:
    """Passes the events of a record to a controller.

    Args:
        controller: The controller; None: made from the setup in the record.
    """

    def __init__(self, controller: Controller | None = None) -> None:
        self.controller = controller
        self._mapper: Mapper | None = None  # the vehicle's map; None until the setup
        # Recorded motions with the ones decided now: the controller compares motions by identity.
        self._motions: deque[tuple[Any, Any]] = deque(maxlen=4 * RECENT)

    def prepare(self, entry: RecordEntry) -> None:
        """Handle the flight loop's other calls to the controller."""
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
        """The controller's actions for an event.

        Raises:
            ReplayError: There is no controller yet.
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
    """Events with their actions, and all other entries, in order.

    Events after the release of the vehicle are omitted, as is the last event of a truncated record:
    its actions may be incomplete. A patch of the map comes after the event before it, with all of
    that event's actions.
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
    """Pass a record's events to a new controller and compare its actions.

    Args:
        entries: The record.
        controller: The controller; None: made from the setup in the record.

    Raises:
        ReplayError: The record has no setup, or no decision to compare.
        LogError: See `air_router.record.log`.
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
        # Numbers are compared bit by bit; NaN equals NaN, and 1 equals 1.0 as in the record.
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
    """An action as text, as read from a record."""
    try:
        return repr(decode(plain_of(action)))
    except TypeError:  # an exception as its text
        return repr(action)
