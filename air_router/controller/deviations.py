"""What follows where the vehicle is off what was planned, or inputs are missing.

Each deviation is announced when it begins. This table has what follows; nothing does while a pilot
flies, zones are being changed, or the vehicle lands.

| deviation | begins | what follows |
|---|---|---|
| home moved up or down | at once | hold, then on in the planned height, by points |
| home moved to a side | at once | it is announced: only the autopilot's own Return flies there |
| too low or too high | 4 s off the altitudes of the mission | hold, then back to them and on |
| the altitude jumps: within them, or off them | at once | hold, then on; hold until it is back |
| one of the last two | 30 s | home |
| the satellites' altitude leaves the autopilot's by 3.5 m | for some seconds | it is announced |
| by 6 m | for some seconds | home, and every zone counts whatever its height |
| nearer to a zone or the fence than the clearance | at once | hold, then away from there and on |
| satellites (h_acc) or wind worse than planned for | for 3 s | hold until they are good for 5 s |
| that | 30 s | home |
| faster than commanded | for 2 s | hold, then on at the commanded speed |
| much slower | for 5 s of a leg | it is announced |
| one of these, a third time within 3 minutes | at once | home |
| the battery at its reserve, or little above what the way home takes | at once | home |
| this program stood still for 0.5 s, or was starved | at once | it is announced, once in 30 s |
| it stood still for 2 s | at once | hold, then on: what it flew over was not checked |
| the charge jumps by more than 5 % | at once | it counts after 3 s, or if the voltage fell |
| the mission's duration, or the hours that its zones were chosen for, are over | at once | home |

Where no way home is clear of zones whatever their height it hovers; requested `home` once more, or
with the battery at its reserve, it comes home by a way that is clear at the autopilot's altitude.

For a fix, a position or the battery that is missing, `InputLimit` has what follows.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import partial

from air_router.controller.envelope import Envelope, ReturnMonitor
from air_router.controller.lag_monitor import LagMonitor
from air_router.controller.limits import DEVIATION_HOLD_S, DEVIATION_TIMES, DEVIATION_WITHIN_S
from air_router.controller.model import OFF_PLAN, MissionContext, Signal, State
from air_router.controller.motion import CommandGate
from air_router.controller.safety_monitor import Deviation, Response
from air_router.vehicle import (
    BE_READY_AT_HOME,
    INPUT_ALARMS,
    NO_OTHER_HOME,
    InputAnnouncement,
    InputResponse,
    InputStatus,
    Telemetry,
)


@dataclass(slots=True, eq=False)
class Deviations:
    """Has a vehicle that flies its mission by our commands keep to what was planned.

    Args:
        context: Where it says what is off or missing, and has it come home.
        gate: Has it hold.
        returns: Checks time and charge, which go on while inputs are missing.
        lag: Whether this program itself has just stood still.
        envelope: What is off.
    """

    _context: MissionContext
    _gate: CommandGate
    _returns: ReturnMonitor
    _lag: LagMonitor
    _envelope: Envelope
    _unsaid: set[str] = field(default_factory=set)  # what seemed to be missing just after a lag
    _times: deque[float] = field(
        default_factory=partial(deque, maxlen=DEVIATION_TIMES)
    )  # holds, when

    def follow(self, telemetry: Telemetry) -> None:
        """Say what is off, or is over, and do what follows."""
        for deviation in self._lag.update(telemetry) + self._envelope.update(telemetry):
            again = deviation.counts and self._happens_again(self._context.last_telemetry.time_s)
            self._respond(deviation._replace(response=Response.HOME) if again else deviation)

    def home_moved(self, moved: Response, *, cruises: bool) -> None:
        """Do what follows home having been moved just now, which is announced already.

        Args:
            moved: What that is.
            cruises: The vehicle flies at its altitudes; if not, only a leg on which it is while
                zones change is held for.
        """
        if cruises:
            self._respond(Deviation(moved, "home was moved", NO_OTHER_HOME), said=True)
        elif moved is Response.HOLD and self._context.airspace.change is not None:
            self._gate.stop()
            self._context.airspace.stop_first()
            self._gate.hold("home was moved")

    def inputs_missing(self, status: InputStatus, telemetry: Telemetry) -> bool:
        """Announce which inputs are missing; returns whether too few arrive to fly on."""
        context = self._context
        landing = context.task.state is State.LAND  # PX4 does so without a position too
        self._announce_inputs(status, telemetry, landing=landing)
        if status.home_why is not None:
            context.come_home(status.home_why, BE_READY_AT_HOME)
        if context.task.state is State.READY:
            return False
        if status.stop is InputResponse.NONE:
            if status.back:
                context.retry_in(0.0)
            return False
        # What is flown ends at once; a hold that was not followed is commanded again after a pause.
        pauses = not context.take_retry() and context.task.retry_at_s is not None
        pauses &= self._gate.last is None
        if status.stop is InputResponse.HOLD and not landing and not pauses:
            self._gate.hold(status.why)  # unless that is what it does
        self._returns.check(telemetry)  # time and charge go on
        if context.left_s == 0.0 and context.airspace.change is None:
            context.signal(Signal.TIMER)
        return True

    def _announce_inputs(self, status: InputStatus, telemetry: Telemetry, *, landing: bool) -> None:
        """Announce what is missing, and what is back."""
        context = self._context
        for announcements in status.announcements:
            if self._is_our_own(announcements):
                continue
            then = announcements.then
            if then and landing:
                then = "landing on"
            elif then and context.task.state is State.READY:
                then = "the climb goes on"  # it ends above home by itself
            text = f"{announcements.what}: {then}" if then else announcements.what
            if announcements.alarms and announcements.instruction is not None and not landing:
                context.alarm_until_over(
                    announcements.about,
                    text,
                    announcements.instruction,
                    lasting=announcements.about,
                    since_s=telemetry.received_s - announcements.age_s,
                )
            else:
                context.announce(text, announcements.instruction)
        for about in set(context.alarms.shown) & INPUT_ALARMS - set(context.inputs.stopped):
            context.over(about)

    def _is_our_own(self, announcements: InputAnnouncement) -> bool:
        """Whether what seems to be missing may wait in this program's own sockets."""
        if announcements.instruction is None:
            announced = announcements.about not in self._unsaid
            self._unsaid.discard(announcements.about)
            return not announced
        if self._lag.recent and not announcements.alarms:
            self._unsaid.add(announcements.about)
            return True
        self._unsaid.discard(announcements.about)
        return False

    def forget(self) -> None:
        """It does not fly its mission by our commands just now: what was off is checked anew."""
        self._envelope.forget()
        for anomaly in OFF_PLAN:
            self._context.interlocks.put(anomaly, raised=False)

    def _respond(self, deviation: Deviation, *, said: bool = False) -> None:
        response, words, instruction, _, alarms, anomaly = deviation
        context = self._context
        if anomaly is not None:  # raised and cleared here alone
            context.interlocks.put(anomaly, raised=response is Response.WAIT)
        if response is Response.HOME:
            comes_home = context.knows(Signal.COME_HOME)
            context.come_home(words, instruction)
            if comes_home:
                return
        holds = response in {Response.HOLD, Response.WAIT, Response.HOME}
        if words and not said:
            text = f"{words}: holding" if holds else words
            context.announce(text, instruction, alarms=alarms)
        if holds:
            self._gate.hold(words)
        if response is not Response.ANNOUNCE:
            context.retry_in(0.0 if response is Response.BACK else DEVIATION_HOLD_S)

    def _happens_again(self, now_s: float) -> bool:
        """Whether it was held for so often lately that holding once more will not help."""
        self._times.append(now_s)
        if len(self._times) < DEVIATION_TIMES or now_s - self._times[0] > DEVIATION_WITHIN_S:
            return False
        self._times.clear()
        return True
