"""Where requests of one flight are handed in: at the terminal, from programs, from the map page.

All come this way, so all are recorded, looked at and answered alike. Only the flight's own event
loop may use it.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterable
from typing import Any

from air_router.control.command_request import CommandRequest, CommandRequestError, View
from air_router.controller.controller import Controller
from air_router.controller.model.actions import Action, CommandAck, Refusal
from air_router.controller.model.events import OPERATOR, AnyRequest
from air_router.flight.mission_reloader import ReloadReport
from geo.frame import LocalFrame, Point

_DIGITS = 8
"""Of a degree: a millimetre."""


class CommandService:
    """Hands requests to the flight, and its answers back.

    Args:
        frame: The mission's.
        controller: Who answers, for what is said about the flight.
        decide: Has a request decided as every event is; returns what was decided.
        reading: Tells what became of the latest reading of the mission file.
        view: Tells what a program asks that shows the flight, besides its situation.
    """

    def __init__(
        self,
        frame: LocalFrame,
        controller: Controller,
        decide: Callable[[AnyRequest], Iterable[Action]],
        reading: Callable[[], ReloadReport | None] = lambda: None,
        view: Callable[[View], dict[str, Any]] = lambda _: {},
    ) -> None:
        self._view = view
        self._reading = reading
        self._frame = frame
        self._controller = controller
        self._decide = decide
        self._number = 0  # of the latest request without an id

    def ask(self, request: AnyRequest) -> CommandAck:
        """Ask for something, in the mission's metres; the answer says whether it is done."""
        self._number += 1
        number = request.request_id or str(self._number)
        for action in self._decide(dataclasses.replace(request, request_id=number)):
            if isinstance(action, CommandAck) and action.request_id == number:
                return action
        return CommandAck(number, request.by, False, "the flight is over", Refusal.FLIGHT_OVER)

    def typed(self, say: Callable[[str], None], command: CommandRequest) -> None:
        """The operator has typed something; its answer is shown as every answer is."""
        try:
            reply = self.grant(command, OPERATOR)
        except CommandRequestError as error:
            say(str(error))
        else:
            if "accepted" not in reply:
                say(json.dumps(reply))

    def grant(self, command: CommandRequest, by: str) -> dict[str, Any]:
        """Ask for something, in degrees; returns what a program is answered, in JSON's values.

        Raises:
            CommandRequestError: a place cannot be told in the mission's frame.
        """
        request = command.asked(self._frame, by)
        if request is None:
            more = self._view(command) if isinstance(command, View) else {}
            return {"ok": True, "id": command.id, **self.situation(), **more}
        answer = self.ask(request)
        reply: dict[str, Any] = {
            "ok": True,
            "id": command.id,
            "accepted": answer.accepted,
            "why": answer.why,
            "code": answer.code,
            "state": self._controller.context.state.name,
        }
        if answer.points:
            reply["points"] = [self._pair(point) for point in answer.points]
        return reply

    def situation(self) -> dict[str, Any]:
        """What the flight is doing now."""
        controller, telemetry = self._controller, self._controller.telemetry
        goal, goto_task = controller.context.way.goal, controller.goto_task
        left_s, reading = controller.time_left_s, self._reading()
        about: dict[str, Any] = {
            "state": controller.state.name,
            "robot": controller.robot,
            "robots": list(controller.search.targets.names),
            "time_left_s": None if left_s is None else round(left_s, 1),
            "goal": None if goal is None else self._pair(goal.position),
            "points_left": 0,
            "waypoints_left": controller.exploration.remaining,
            "walled_in": controller.no_way_home,
            "reload": None if reading is None else dataclasses.asdict(reading),
        }
        if controller.state.name == "GOTO" and goto_task is not None:
            about["points_left"] = len(goto_task.stops) - goto_task.done
        if telemetry is None:
            return {**about, "position": None}
        return {
            **about,
            "position": self._pair(telemetry.position),
            "altitude_m": round(telemetry.altitude_m, 2),
            "speed_m_s": round(math.hypot(*telemetry.velocity_m_s), 2),
            "heading_deg": telemetry.heading_deg,
            "wind_m_s": telemetry.wind_m_s,
            "home_moved_m": telemetry.home_moved,
            "battery": telemetry.battery,
            "mode": telemetry.mode.value,
            "armed": telemetry.armed,
            "in_air": telemetry.in_air,
            "in_charge": controller.in_charge,
            "time_s": telemetry.time_s,
        }

    def _pair(self, point: Point) -> list[float]:
        return [round(degrees, _DIGITS) for degrees in self._frame.to_geodetic(point)]
