"""What follows where the vehicle is off what was planned.

Each deviation is told when it begins. What follows is in this table; nothing follows while a pilot
flies, zones are being changed, or the vehicle lands.

| deviation | begins | what follows |
|---|---|---|
| home moved up or down | at once | hold, then on in the planned height, by points |
| home moved to a side | at once | it is told: only the autopilot's own Return flies there |
| too low or too high | 4 s off the altitudes of the mission | hold, then back to them and on |
| the altitude jumps: within them, or off them | at once | hold, then on; hold until it is back |
| one of the last two | 30 s | home |
| the satellites' altitude leaves the autopilot's by 3.5 m | for some seconds | it is told |
| by 6 m | for some seconds | home: which of both is right? |
| nearer to a zone or the fence than the clearance | at once | hold, then away from there and on |
| faster than commanded | for 2 s | hold, then on at the commanded speed |
| much slower | for 5 s of a leg | it is told |
| one of these, a third time within 3 minutes | at once | home |
| the battery at its reserve, or little above what the way home takes | at once | home |
| the mission's duration is over | at once | home |
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from air_router.controller.envelope import ClearanceWatch, HeightWatch, SpeedWatch
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.states import Signal
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.safety_monitor import DOUBT_M, HomeWatch, Response
from air_router.vehicle.vehicle import Telemetry

HOLD_S: Final = 2.0
"""A vehicle that holds for a deviation stands after so long, and goes on."""

TIMES: Final = 3
WITHIN_S: Final = 180.0
"""What has happened so often in that time will happen again."""


@dataclass(slots=True, eq=False)
class Deviations:
    """Looks at every telemetry of a vehicle that flies its mission by our commands.

    Args:
        context: What was planned.
        gate: What the vehicle was told last; has it hold.
        home: Where the autopilot's home is, and what the satellites say of the altitude.
    """

    _context: MissionContext
    _gate: CommandGate
    _home: HomeWatch
    _height: HeightWatch = field(init=False)
    _clearance: ClearanceWatch = field(init=False)
    _speed: SpeedWatch = field(init=False)
    _times: deque[float] = field(default_factory=partial(deque, maxlen=TIMES))  # holds, when

    def __post_init__(self) -> None:
        self._height = HeightWatch(self._context)
        self._clearance = ClearanceWatch(self._context)
        self._speed = SpeedWatch(self._context, self._gate)

    def keep(self, telemetry: Telemetry, moved: Response | None) -> None:
        """Have the vehicle keep to what was planned, and say where it does not.

        Args:
            telemetry: What is looked at.
            moved: What follows home having been moved just now, which is told already.
        """
        if moved is not None:
            self._respond(moved, "home was moved", said=True)
        in_doubt = abs(self._home.receiver_off_m) >= DOUBT_M
        found = (
            self._height.look(telemetry),
            self._home.doubt(telemetry) if in_doubt else None,
            self._clearance.look(telemetry),
            self._speed.look(telemetry),
        )
        for deviation in filter(None, found):
            again = deviation.counts and self._happens_again(telemetry.time_s)
            self._respond(Response.HOME if again else deviation.response, deviation.words)

    def stand_aside(self, moved: Response | None) -> None:
        """It does not fly at its altitudes just now; on a leg a home that moves is held for."""
        self.forget()
        if moved is Response.HOLD and self._context.zones is not None:
            self._gate.stop()
            self._context.has_to_stop = True
            self._gate.hold("home was moved")

    def forget(self) -> None:
        """It does not fly its mission by our commands just now."""
        for watch in (self._height, self._clearance, self._speed):
            watch.forget()

    def _respond(self, response: Response, words: str, *, said: bool = False) -> None:
        context = self._context
        if response is Response.HOME:
            comes_home = context.knows(Signal.COME_HOME)
            context.come_home(words)
            if comes_home:
                return
        holds = response in {Response.HOLD, Response.WAIT, Response.HOME}
        if not said:
            context.say(f"{words}: holding" if holds else words)
        if holds:
            self._gate.hold(words)
        if response is not Response.TELL:
            context.retry_in(0.0 if response is Response.BACK else HOLD_S)

    def _happens_again(self, now_s: float) -> bool:
        """Whether it was held for so often lately that holding once more will not help."""
        self._times.append(now_s)
        if len(self._times) < TIMES or now_s - self._times[0] > WITHIN_S:
            return False
        self._times.clear()
        return True
