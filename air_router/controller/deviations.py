"""Responds to deviations from the plan and to missing inputs.

Each deviation is announced when it begins. This table has the responses. There is none while a
pilot flies, zones are being changed, or the vehicle lands; only for a home that moved up or down
does it also stop while zones are being changed.

| deviation | begins | response |
|---|---|---|
| home moved up or down | at once | hold, then on at the planned altitude, by DO_REPOSITION |
| home moved sideways | at once | announced: only PX4's own Return flies there |
| too low or too high | 4 s off the mission's altitudes | hold, then back to them and on |
| the altitude jumps within them / off them | at once | hold, then on / hold until it recovers |
| either of the last two | for 30 s | home |
| GPS and PX4 altitudes differ by 3.5 m | for some seconds | announced |
| by 6 m | for some seconds | home, and all zones apply at every altitude |
| nearer to a zone or the fence than the clearance | at once | hold, then move away and on |
| GPS accuracy (h_acc) or wind worse than planned | for 3 s | hold until good for 5 s |
| the same | for 30 s | home |
| faster than commanded | for 2 s | hold, then on at the commanded speed |
| much slower | for 5 s of a leg | announced |
| a third hold for these within 3 minutes | at once | home |
| the battery at its reserve, or near the charge for the way home | at once | home |
| this program stalled for 0.5 s | at once | announced, once in 30 s |
| it stalled for 2 s | at once | hold, then on: the track was not checked |
| the charge jumps by more than 5 % | at once | counts after 3 s, or if the voltage fell |
| the mission's duration, or its zones' active hours, are over | at once | home |

If no way home is clear of all zones at every altitude, the vehicle hovers. At the next `home`
request, or with the battery at its reserve, it comes home by a way that is clear at PX4's altitude.

`InputLimit` has the responses to a missing fix, position or battery.
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
    """Carries out the responses while the vehicle flies its mission.

    Args:
        context: Receives announcements, retries and returns.
        gate: Commands holds.
        returns: Checks time and charge, also while inputs are missing.
        lag: Knows whether this program has just stalled.
        envelope: Finds the deviations.
    """

    _context: MissionContext
    _gate: CommandGate
    _returns: ReturnMonitor
    _lag: LagMonitor
    _envelope: Envelope
    _suppressed: set[str] = field(default_factory=set)  # inputs missing just after a stall
    _times: deque[float] = field(
        default_factory=partial(deque, maxlen=DEVIATION_TIMES)
    )  # times of holds

    def follow(self, telemetry: Telemetry) -> None:
        """Announce each deviation and carry out its response."""
        for deviation in self._lag.update(telemetry) + self._envelope.update(telemetry):
            again = deviation.counts and self._happens_again(self._context.last_telemetry.time_s)
            self._respond(deviation._replace(response=Response.HOME) if again else deviation)

    def home_moved(self, moved: Response, *, cruises: bool) -> None:
        """Respond to a change of home, which is announced already.

        Args:
            moved: The response.
            cruises: The vehicle flies at its altitudes. If not, it holds only on a leg during a
                change of zones.
        """
        if cruises:
            self._respond(Deviation(moved, "home was moved", NO_OTHER_HOME), announced=True)
        elif moved is Response.HOLD and self._context.airspace.change is not None:
            self._gate.stop()
            self._context.airspace.stop_first()
            self._gate.hold("home was moved")

    def inputs_missing(self, status: InputStatus, telemetry: Telemetry) -> bool:
        """Announce missing inputs; return whether too few are received to fly on."""
        context = self._context
        landing = context.task.state is State.LAND  # PX4 lands without a position, too
        self._announce_inputs(status, telemetry, landing=landing)
        if status.home_why is not None:
            context.come_home(status.home_why, BE_READY_AT_HOME)
        if context.task.state is State.READY:
            return False
        if status.stop is InputResponse.NONE:
            if status.back:
                context.retry_in(0.0)
            return False
        # The current leg ends at once; a hold that failed is commanded again after a pause.
        pauses = not context.take_retry() and context.task.retry_at_s is not None
        pauses &= self._gate.last is None
        if status.stop is InputResponse.HOLD and not landing and not pauses:
            self._gate.hold(status.why)  # has no effect if it holds already
        self._returns.check(telemetry)  # time and charge still count
        if context.left_s == 0.0 and context.airspace.change is None:
            context.signal(Signal.TIMER)
        return True

    def _announce_inputs(self, status: InputStatus, telemetry: Telemetry, *, landing: bool) -> None:
        """Announce inputs that are missing or received again."""
        context = self._context
        for announcement in status.announcements:
            if self._is_our_own(announcement):
                continue
            then = announcement.then
            if then and landing:
                then = "the landing continues"
            elif then and context.task.state is State.READY:
                then = "the climb continues"  # PX4 ends it above home on its own
            text = f"{announcement.what}: {then}" if then else announcement.what
            if announcement.alarms and announcement.instruction is not None and not landing:
                context.alarm_until_over(
                    announcement.about,
                    text,
                    announcement.instruction,
                    lasting=announcement.about,
                    since_s=telemetry.received_s - announcement.age_s,
                )
            else:
                context.announce(text, announcement.instruction)
        for about in set(context.alarms.shown) & INPUT_ALARMS - set(context.inputs.stopped):
            context.over(about)

    def _is_our_own(self, announcement: InputAnnouncement) -> bool:
        """Whether a missing input may only wait in this program's sockets after a stall."""
        if announcement.instruction is None:
            announced = announcement.about not in self._suppressed
            self._suppressed.discard(announcement.about)
            return not announced
        if self._lag.recent and not announcement.alarms:
            self._suppressed.add(announcement.about)
            return True
        self._suppressed.discard(announcement.about)
        return False

    def forget(self) -> None:
        """Reset: the vehicle does not fly its mission now."""
        self._envelope.forget()
        for anomaly in OFF_PLAN:
            self._context.interlocks.put(anomaly, raised=False)

    def _respond(self, deviation: Deviation, *, announced: bool = False) -> None:
        response, words, instruction, _, alarms, anomaly = deviation
        context = self._context
        if anomaly is not None:  # raised and cleared only here
            context.interlocks.put(anomaly, raised=response is Response.WAIT)
        if response is Response.HOME:
            comes_home = context.knows(Signal.COME_HOME)
            context.come_home(words, instruction)
            if comes_home:
                return
        holds = response in {Response.HOLD, Response.WAIT, Response.HOME}
        if words and not announced:
            text = f"{words}: holding" if holds else words
            context.announce(text, instruction, alarms=alarms)
        if holds:
            self._gate.hold(words)
        if response is not Response.ANNOUNCE:
            context.retry_in(0.0 if response is Response.BACK else DEVIATION_HOLD_S)

    def _happens_again(self, now_s: float) -> bool:
        """Whether so many recent holds show that another one will not help."""
        self._times.append(now_s)
        if len(self._times) < DEVIATION_TIMES or now_s - self._times[0] > DEVIATION_WITHIN_S:
            return False
        self._times.clear()
        return True
