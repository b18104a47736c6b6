"""Goals of a ROS 2 action: a request to the flight, followed to its end. Pure.

A goal is over when the flight leaves the state that it asked for. What led out of it, a signal of
the state machine, says whether it was reached.
"""

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Final

GoalId = str
"""Its UUID, in Base64."""

Change = Mapping[str, Any]
"""A change of state, as `view` has it."""

ANY: Final[GoalId] = base64.b64encode(bytes(16)).decode()
_KEPT: Final = 32
"""So many goals that are over can still be asked for their results."""


class Status(IntEnum):
    """As in action_msgs/GoalStatus."""

    UNKNOWN = 0
    EXECUTING = 2
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


class Cancel(IntEnum):
    """Return codes of action_msgs/CancelGoal."""

    DONE = 0
    REJECTED = 1
    UNKNOWN_GOAL = 2
    ENDED = 3


@dataclass(frozen=True, slots=True)
class GoalSpec:
    """How the states of an action follow each other.

    Attributes:
        begin: State and signal with which it begins.
        on: Signals that lead on within it, by state.
        done: State and signal by which it is reached.
        reached: What is said then.
    """

    begin: tuple[str, str]
    done: tuple[str, str]
    reached: str
    on: tuple[tuple[str, str], ...] = ()


GOTO: Final = GoalSpec(
    begin=("GOTO", "GOTO"), done=("GOTO", "TIMER"), reached="it was at the last point"
)
SEEK: Final = GoalSpec(
    begin=("SEARCH", "SEEK"),
    on=(("SEARCH", "FOUND"),),
    done=("COMM", "SYNCED"),
    reached="both directions have synced",
)


@dataclass(slots=True)
class Goal:
    """One goal.

    Attributes:
        accepted_s: When it came, Unix seconds.
        since: The newest change of state that was known before.
        begun: Whether the flight was seen to begin with it.
        message: What the flight answered; then also why it ended.
        code: Of a refusal.
    """

    goal_id: GoalId
    accepted_s: float
    since: int
    status: Status = Status.EXECUTING
    begun: bool = False
    message: str = ""
    code: str = ""

    @property
    def over(self) -> bool:
        """Whether it has a result."""
        return self.status is not Status.EXECUTING

    def end(self, status: Status, message: str, code: str = "") -> None:
        """It has a result from now on."""
        self.status, self.code = status, code
        self.message = f"{self.message}; {message}" if self.message else message

    def follow(self, spec: GoalSpec, changes: Sequence[Change]) -> None:
        """Take in the latest changes of state."""
        for change in changes:
            if change["number"] <= self.since or self.over:
                continue
            self.since = change["number"]
            signal = (change["left"], change["signal"])
            if not self.begun:
                self.begun = (change["state"], change["signal"]) == spec.begin
            elif signal == spec.done:
                self.end(Status.SUCCEEDED, spec.reached)
            elif signal not in spec.on:
                self.end(Status.ABORTED, f"{change['left']} -> {change['state']}: {change['why']}")


@dataclass(slots=True)
class Goals:
    """The goals of one action, oldest first."""

    spec: GoalSpec
    goals: dict[GoalId, Goal] = field(default_factory=dict)  # by id

    def begin(self, goal_id: GoalId, now_s: float, since: int) -> Goal | None:
        """A new goal; None if there was one of this id."""
        if goal_id in self.goals:
            return None
        ended = [goal.goal_id for goal in self.goals.values() if goal.over]
        for old in ended[: max(0, len(ended) - _KEPT + 1)]:
            del self.goals[old]
        self.goals[goal_id] = goal = Goal(goal_id, now_s, since)
        return goal

    def abort(self, why: str) -> None:
        """None of them can be reached any more."""
        for goal in self.active():
            goal.end(Status.ABORTED, why)

    def follow(self, changes: Sequence[Change]) -> None:
        """Take in the latest changes of state."""
        for goal in self.active():
            goal.follow(self.spec, changes)

    def active(self) -> Iterator[Goal]:
        """Goals without a result."""
        yield from [goal for goal in self.goals.values() if not goal.over]

    def to_cancel(self, goal_id: GoalId, until_s: float) -> tuple[Cancel, list[Goal]]:
        """The goals that a request to cancel means, as action_msgs/CancelGoal says.

        `goal_id` may be `ANY`; `until_s`: those that came by then, too; 0: none.
        """
        everything = goal_id == ANY and until_s == 0.0
        meant = [
            goal
            for goal in self.goals.values()
            if everything or goal.goal_id == goal_id or goal.accepted_s <= until_s
        ]
        active = [goal for goal in meant if not goal.over]
        if active or goal_id == ANY:
            return Cancel.DONE, active
        return (Cancel.ENDED if meant else Cancel.UNKNOWN_GOAL), []
