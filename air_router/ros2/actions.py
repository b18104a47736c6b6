"""ROS 2 actions: their goals, and the services and topics that an action is made of.

A goal is a request to the flight, followed to its end. It is over when the flight leaves the state
that it requested. Whether it was reached follows from the signal that led out of that state.
"""

import base64
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Final

from air_router.control import ControlReply
from air_router.gossip import stamp
from air_router.ros2.messages import CANCEL, Values
from air_router.ros2.ros_graph import RosGraph

GoalId = str
"""Its UUID, in Base64."""

Change = Mapping[str, Any]
"""A change of state, as `view` has it."""

ANY: Final[GoalId] = base64.b64encode(bytes(16)).decode()
_KEPT: Final = 32
"""Finished goals whose results are kept for clients."""


STATUS_LIST: Final = "action_msgs/GoalStatusArray"

Answer = Callable[[Values], Values | None]
"""Answers a request of a service; None: later."""


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
        reached: The message then.
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
        """The goals that a request to cancel means, as action_msgs/CancelGoal defines.

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


class ActionServer:
    """One action.

    Args:
        graph: Where it is served.
        serve: Has a service answered on the thread that uses this object.
        name: Of the action, e.g. ``/titan/goto``.
        kind: Its type.
        spec: Of the states that fulfil it.
        submit: Submits a goal's values to the flight.
        hold: Requests a hold of the flight: so goals are cancelled.
        newest: The number of the flight's newest change of state.
        unix_s: The time.
    """

    def __init__(  # noqa: PLR0913 - what lies between a flight and ROS
        self,
        graph: RosGraph,
        serve: Callable[[str, str, Answer], None],
        name: str,
        kind: str,
        spec: GoalSpec,
        *,
        submit: Callable[[Values], ControlReply],
        hold: Callable[[], ControlReply],
        newest: Callable[[], int],
        unix_s: Callable[[], float],
    ) -> None:
        self.goals = Goals(spec)
        self._graph, self._kind = graph, kind
        self._submit, self._hold, self._newest, self._unix_s = submit, hold, newest, unix_s
        inside = f"{name}/_action"  # prefix of its services and topics
        self._feedback, self._statuses = f"{inside}/feedback", f"{inside}/status"
        self._results = f"{inside}/get_result"
        self._waiting: list[tuple[GoalId, Values]] = []  # for their results
        self._published: list[Values] | None = None  # statuses published last
        graph.advertise(self._feedback, f"{kind}_FeedbackMessage", 10, lasting=False)
        graph.advertise(self._statuses, STATUS_LIST)
        serve(f"{inside}/send_goal", f"{kind}_SendGoal", self._send_goal)
        serve(f"{inside}/cancel_goal", CANCEL, self._cancel)
        serve(self._results, f"{kind}_GetResult", self._get_result)
        self.publish()

    def feed(self, feedback: Values) -> None:
        """Publish the feedback of the goal under way."""
        for goal in self.goals.active():
            values = {"goal_id": {"uuid": goal.goal_id}, "feedback": feedback}
            self._graph.publish(self._feedback, f"{self._kind}_FeedbackMessage", values)

    def publish(self) -> None:
        """Publish the status of goals, and results that clients wait for."""
        statuses = [
            {"goal_info": _info(goal), "status": goal.status.value}
            for goal in self.goals.goals.values()
        ]
        if statuses != self._published:
            self._published = statuses
            self._graph.publish(self._statuses, STATUS_LIST, {"status_list": statuses})
        waiting, self._waiting = self._waiting, []
        for goal_id, request in waiting:
            result = self._result(goal_id)
            if result is None:
                self._waiting.append((goal_id, request))
            else:
                self._graph.reply(self._results, f"{self._kind}_GetResult", request, result)

    def _send_goal(self, request: Values) -> Values:
        """Take a goal; a refusal is its result, the first ROS message that has a reason."""
        now_s = self._unix_s()
        goal = self.goals.begin(request["goal_id"]["uuid"], now_s, self._newest())
        if goal is None:
            return {"accepted": False}
        answer = self._submit(request["goal"])
        if answer.accepted:
            goal.message = answer.why
        else:
            goal.end(Status.ABORTED, answer.why, answer.code or "")
        return {"accepted": True, "stamp": stamp(now_s)}

    def _cancel(self, request: Values) -> Values:
        about = request["goal_info"]
        moment = about["stamp"]
        code, goals = self.goals.to_cancel(
            about["goal_id"]["uuid"], moment["sec"] + moment["nanosec"] / 1e9
        )
        if goals:
            answer = self._hold()
            if not answer.accepted:
                return {"return_code": Cancel.REJECTED.value}
            for goal in goals:
                goal.end(Status.CANCELED, answer.why)
        return {"return_code": code.value, "goals_canceling": [_info(goal) for goal in goals]}

    def _get_result(self, request: Values) -> Values | None:
        goal_id = request["goal_id"]["uuid"]
        result = self._result(goal_id)
        if result is None:
            self._waiting = [*self._waiting[-99:], (goal_id, request)]
        return result

    def _result(self, goal_id: GoalId) -> Values | None:
        """Of a goal that is over; of one that is not known nothing but that."""
        goal = self.goals.goals.get(goal_id)
        if goal is None:
            return {"status": Status.UNKNOWN.value}
        if not goal.over:
            return None
        return {
            "status": goal.status.value,
            "result": {"message": goal.message, "code": goal.code},
        }


def _info(goal: Goal) -> Mapping[str, Any]:
    return {"goal_id": {"uuid": goal.goal_id}, "stamp": stamp(goal.accepted_s)}
