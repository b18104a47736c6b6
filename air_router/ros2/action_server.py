"""Serves one ROS 2 action: the services and topics that an action is made of."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from air_router.control.control import ControlAnswer
from air_router.gossip.ros_messages import stamp
from air_router.ros2.goals import Cancel, Goal, GoalId, Goals, GoalSpec, Status
from air_router.ros2.interfaces import CANCEL
from air_router.ros2.messages import Values
from air_router.ros2.ros_graph import RosGraph

STATUS_LIST: Final = "action_msgs/GoalStatusArray"

Answer = Callable[[Values], Values | None]
"""Answers a request of a service; None: later."""


class ActionServer:
    """One action.

    Args:
        graph: Where it is served.
        serve: Has a service answered on the thread that uses this object.
        name: Of the action, e.g. ``/titan/goto``.
        kind: Its type.
        spec: Of the states that fulfil it.
        ask: Asks the flight for a goal's values.
        hold: Asks the flight to hold: so goals are cancelled.
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
        ask: Callable[[Values], ControlAnswer],
        hold: Callable[[], ControlAnswer],
        newest: Callable[[], int],
        unix_s: Callable[[], float],
    ) -> None:
        self.goals = Goals(spec)
        self._graph, self._kind = graph, kind
        self._ask, self._hold, self._newest, self._unix_s = ask, hold, newest, unix_s
        self._inside = f"{name}/_action"  # prefix of its services and topics
        self._waiting: list[tuple[GoalId, Values]] = []  # for their results
        self._told: list[Values] | None = None  # statuses published last
        graph.advertise(self._feedback, f"{kind}_FeedbackMessage", 10, lasting=False)
        graph.advertise(self._statuses, STATUS_LIST)
        serve(f"{self._inside}/send_goal", f"{kind}_SendGoal", self._send_goal)
        serve(f"{self._inside}/cancel_goal", CANCEL, self._cancel)
        serve(self._results, f"{kind}_GetResult", self._get_result)
        self.tell()

    @property
    def _feedback(self) -> str:
        return f"{self._inside}/feedback"

    @property
    def _statuses(self) -> str:
        return f"{self._inside}/status"

    @property
    def _results(self) -> str:
        return f"{self._inside}/get_result"

    def feed(self, feedback: Values) -> None:
        """Tell how far a goal that is under way has come."""
        for goal in self.goals.active():
            values = {"goal_id": {"uuid": goal.goal_id}, "feedback": feedback}
            self._graph.publish(self._feedback, f"{self._kind}_FeedbackMessage", values)

    def tell(self) -> None:
        """Tell how goals stand, and the results that are waited for."""
        statuses = [
            {"goal_info": _info(goal), "status": goal.status.value}
            for goal in self.goals.goals.values()
        ]
        if statuses != self._told:
            self._told = statuses
            self._graph.publish(self._statuses, STATUS_LIST, {"status_list": statuses})
        waiting, self._waiting = self._waiting, []
        for goal_id, request in waiting:
            result = self._result(goal_id)
            if result is None:
                self._waiting.append((goal_id, request))
            else:
                self._graph.reply(self._results, f"{self._kind}_GetResult", request, result)

    def _send_goal(self, request: Values) -> Values:
        """Take a goal; a refusal of the flight is its result, for ROS has no words before it."""
        now_s = self._unix_s()
        goal = self.goals.begin(request["goal_id"]["uuid"], now_s, self._newest())
        if goal is None:
            return {"accepted": False}
        answer = self._ask(request["goal"])
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
