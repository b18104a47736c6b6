"""Bridges one flight and ROS 2: publishes its status, and forwards the requests of ROS programs.

It is a client of the flight's control endpoint, as every program is.
"""

import contextlib
import json
import math
import queue
import time
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from air_router.control import (
    ControlClient,
    ControlError,
    ControlReply,
    ControlUnreachableError,
    parse_command,
)
from air_router.errors import AirRouterError
from air_router.ros2 import actions, messages
from air_router.ros2.actions import ActionServer, Answer
from air_router.ros2.messages import TOPICS, Scene, Values
from air_router.ros2.ros_graph import RosGraph
from air_router.ros2.sampler import POLL_S, Sampler
from mocha_link.bridges import channel
from mocha_link.errors import RequestError

_MOST_WAITING: Final = 100
"""Requests of ROS programs that wait for their turn; more are refused."""

BY: Final = "ROS 2"
TEXT: Final = "std_msgs/String"
ANSWERS: Final = "~/answer"
TRIGGERS: Final = ("hold", "resume", "explore", "home", "land")

_ALTITUDE: Final = "an altitude of a point is not 0: the flight keeps to the mission's"


class AnotherVehicleError(AirRouterError):
    """Another vehicle flies at the endpoint than before."""


class Ros2Bridge:
    """Runs until a signal ends it; a flight that is lost may come back.

    Args:
        client: Sends requests to the flight.
        graph: The ROS programs.
        requests: Whether ROS programs may send requests.
        say: Takes messages to the operator; called from other threads as well.
        unix_s: The time of messages.
    """

    def __init__(
        self,
        client: ControlClient,
        graph: RosGraph,
        *,
        requests: bool,
        say: Callable[[str], None],
        unix_s: Callable[[], float] = time.time,
    ) -> None:
        self._client, self._graph, self._unix_s = client, graph, unix_s
        self._say = say
        self._requests = requests
        self._jobs: queue.Queue[Callable[[], None]] = queue.Queue(_MOST_WAITING)  # of other threads
        self._name = ""  # the flight's; empty: none was found yet
        self._scene: Scene  # of the flight found last
        self._view: dict[str, Any] = {}  # the newest answer to `view`
        self._sampler: Sampler  # of the same flight
        self._actions: dict[str, ActionServer] = {}  # by name
        self._silent = False  # the operator knows that the flight does not answer

    def run(self) -> None:
        """Poll the flight, and answer requests in between.

        Raises:
            AnotherVehicleError: the endpoint is that of another UAV now.
        """
        poll_s = time.monotonic()
        while True:
            wait_s = poll_s - time.monotonic()
            if wait_s <= 0:
                self.poll()
                poll_s = time.monotonic() + POLL_S
                continue
            with contextlib.suppress(queue.Empty):
                self._jobs.get(timeout=wait_s)()

    def poll(self) -> None:
        """Request the flight's status, and publish it."""
        try:
            view = self._newest_view()
            now_s = self._unix_s()
            self._feed(view)
            for out in self._sampler.messages(view, now_s):
                self._publish(*out)
        except (ControlUnreachableError, ControlError) as error:
            self._is_silent(str(error))

    def _newest_view(self) -> dict[str, Any]:
        view = self._client.request({"request": "view"})
        self._begin(view)
        self._view = view
        for action in self._actions.values():
            action.goals.follow(view["changes"])
            action.publish()
        return view

    def _feed(self, view: dict[str, Any]) -> None:
        """Give the actions their feedback."""
        place, goal, left_s = view["position"], view["goal"], view["time_left_s"]
        away_m = math.nan
        if place is not None and goal is not None:
            away_m = math.dist(self._scene.place(place), self._scene.place(goal))
        feedback = {
            "state": view["state"],
            "distance_m": away_m,
            "time_left_s": math.nan if left_s is None else left_s,
        }
        for name, action in self._actions.items():
            points = {"points_left": view["points_left"]} if name == "goto" else {}
            action.feed({**feedback, **points})

    def _is_silent(self, why: str) -> None:
        if not self._silent:
            self._say(f"waiting for the flight: {why}")
        self._silent = True
        if self._name:
            self._publish(*self._scene.silent(why, self._unix_s()))

    def _begin(self, view: dict[str, Any]) -> None:
        """The flight answers: for the first time, again, or another one does."""
        name = channel(view["uav"] or "uav")[1:]
        if self._name and name != self._name:
            raise AnotherVehicleError(f"{name} flies there now, not {self._name}; start anew")
        if not self._name:
            self._name = name
            self._show(view)
            self._offer()
            self._say(f"ready: /{name} is on ROS 2")
        elif self._silent:
            self._say("the flight answers again")
        self._silent = False
        if self._view and _number(view) < _number(self._view):
            self._show(view)
            for action in self._actions.values():
                action.goals.abort("that flight has ended")

    def _show(self, view: dict[str, Any]) -> None:
        """Another flight begins: everything is published anew."""
        self._scene = Scene(self._name, view["origin"])
        self._sampler = Sampler(
            self._scene, lambda what: self._client.request({"request": "view", what: True})
        )

    # Requests of ROS programs.

    def _offer(self) -> None:
        for topic, kind in TOPICS.items():
            self._graph.advertise(self._topic(topic), kind)
        if not self._requests:
            return
        self._graph.advertise(self._topic(ANSWERS), TEXT, 10, lasting=False)
        self._graph.subscribe(
            self._topic("~/ask"),
            TEXT,
            lambda request: self._later("ask", partial(self._text_request, request)),
        )
        for verb in TRIGGERS:
            self._serve(f"/{self._name}/{verb}", messages.TRIGGER, partial(self._trigger, verb))
        self._serve(f"/{self._name}/altitude", messages.ALTITUDE, self._altitude)
        for name, kind, course, submit in (
            ("goto", messages.GOTO, actions.GOTO, self._goto),
            ("seek", messages.SEEK, actions.SEEK, self._seek),
        ):
            self._actions[name] = ActionServer(
                self._graph,
                self._serve,
                f"/{self._name}/{name}",
                kind,
                course,
                submit=submit,
                hold=lambda: self._reply_of(self._client.hold),
                newest=self._newest,
                unix_s=self._unix_s,
            )

    def _newest(self) -> int:
        """The number of the flight's newest change of state, as far as it answers."""
        with contextlib.suppress(ControlUnreachableError, ControlError):
            self._newest_view()
        return _number(self._view)

    def _serve(self, service: str, kind: str, answer: Answer) -> None:
        """Answer a service between two polls."""

        def respond(request: Values) -> None:
            reply = answer(request)
            if reply is not None:
                self._graph.reply(service, kind, request, reply)

        self._graph.serve(
            service, kind, lambda request: self._later(service, partial(respond, request))
        )

    def _later(self, what: str, job: Callable[[], None]) -> None:
        """Run a job between two polls; from any thread."""
        try:
            self._jobs.put_nowait(job)
        except queue.Full:
            self._say(f"{what}: too many requests; this one is not answered")

    def _text_request(self, message: Values) -> None:
        """Take a request as text, as typed at the terminal: for programs without our services."""
        try:
            request = parse_command(message["data"]).model_dump(exclude_none=True)
            answer = self._client.request({**request, "by": BY})
        except (ControlUnreachableError, RequestError) as error:
            answer = {"accepted": False, "why": str(error)}
        self._graph.publish(self._topic(ANSWERS), TEXT, {"data": json.dumps(answer)})

    def _trigger(self, verb: str, _: Values) -> Values:
        answer = self._reply_of(getattr(self._client, verb))
        return {"success": answer.accepted, "message": answer.why}

    def _altitude(self, request: Values) -> Values:
        answer = self._reply_of(partial(self._client.altitude, request["altitude_m"]))
        return {"success": answer.accepted, "message": answer.why, "code": answer.code or ""}

    def _goto(self, goal: Values) -> ControlReply:
        heights = [point["altitude"] for point in goal["points"]]
        if any(height not in (0.0, "nan") for height in heights):
            return _refused(_ALTITUDE)
        points = [(point["latitude"], point["longitude"]) for point in goal["points"]]
        return self._reply_of(partial(self._client.goto, points, hold_s=goal["hold_s"] or None))

    def _seek(self, goal: Values) -> ControlReply:
        return self._reply_of(partial(self._client.seek, goal["robot"]))

    @staticmethod
    def _reply_of(request: Callable[[], ControlReply]) -> ControlReply:
        """The flight's answer; a refusal where it does not answer."""
        try:
            return request()
        except (ControlUnreachableError, ControlError) as error:
            return _refused(str(error))

    def _publish(self, topic: str, values: Values) -> None:
        self._graph.publish(self._topic(topic), TOPICS[topic], values)

    def _topic(self, topic: str) -> str:
        return topic.replace("~", f"/{self._name}", 1)


def _number(view: dict[str, Any]) -> int:
    """Of the newest change of state."""
    changes = view["changes"]
    return int(changes[-1]["number"]) if changes else 0


def _refused(why: str) -> ControlReply:
    return ControlReply(accepted=False, why=why, code=None, state="")
