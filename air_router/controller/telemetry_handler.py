"""What each word of the vehicle leads to, and in which order: take-off, hands off, flying on."""

from __future__ import annotations

import math
from typing import Final

from air_router.controller.airspace_update import Renewal
from air_router.controller.command_handler import Answering
from air_router.controller.control_authority import Handing
from air_router.controller.model.actions import FlyToNode, HoldHere, Motion, Taker
from air_router.controller.model.behaviour import Signal, State, knows
from air_router.controller.model.events import CommandConfirmed
from air_router.controller.model.mission_context import Cockpit
from air_router.controller.monitor.deviations import Deviation, Deviations, Response
from air_router.controller.monitor.flight_phase import Launch
from air_router.controller.monitor.levelling import Levelling
from air_router.controller.monitor.safety_monitor import Sign, Watch
from air_router.controller.monitor.triggers import HELD, Reminder, Silence, TakeOff, take_off
from air_router.controller.motion.command_gate import Helm
from air_router.controller.states.return_state import Homecoming
from air_router.controller.targets.exploration import Exploration
from air_router.mission.flight_plan import FlightPlan
from air_router.vehicle.input_limits import InputWatch, Stop
from air_router.vehicle.vehicle import FlightMode, ItemReached, LinkSilent, Telemetry

HOLD_S: Final = 2.0
"""A vehicle that holds for a deviation stands after so long, and goes on."""

LATE_S: Final = 2.5
"""A failsafe may show so long after the mode that it chose: HEARTBEAT comes once a second."""


class Watchkeeper:
    """Asks the other parts in turn, the gravest matter first.

    Args:
        cockpit: Where the vehicle's word is kept.
        helm: Flies on.
        plan: The plan on board, for the autopilot's item numbers.
        exploration: Told where the vehicle passes.
        launch: What has been seen of take-off and landing.
        watch: What is found wrong in flight.
        deviations: What is off what was planned.
        inputs: What of the vehicle's word is missing.
        handing: Whose the vehicle is.
        homecoming: Whether the mission ends.
        renewal: Whether zones are being changed.
        levelling: Whether it climbs before its first leg.
        answering: Whether a request waits for its time.
        patient: Somebody else arms: if it is disarmed again on the ground, wait on.
    """

    def __init__(  # noqa: PLR0913 - whoever is asked when the vehicle was heard
        self,
        cockpit: Cockpit,
        helm: Helm,
        plan: FlightPlan,
        exploration: Exploration,
        *,
        launch: Launch,
        watch: Watch,
        deviations: Deviations,
        inputs: InputWatch,
        handing: Handing,
        homecoming: Homecoming,
        renewal: Renewal,
        levelling: Levelling,
        answering: Answering,
        patient: bool,
    ) -> None:
        self._cockpit = cockpit
        self._helm = helm
        self._plan = plan
        self._exploration = exploration
        self._launch = launch
        self._watch = watch
        self._deviations = deviations
        self._inputs = inputs
        self._handing = handing
        self._homecoming = homecoming
        self._renewal = renewal
        self._levelling = levelling
        self._answering = answering
        self._patient = patient
        self._silence = Silence()
        self._breaches = Reminder()
        self._chosen: tuple[FlightMode, float] | None = None

    def wait_for_inputs(self, motion: Motion) -> Motion | None:
        """A guard: where it is, how high, or whose, is not known: it is sent nowhere."""
        missing = self._inputs.why_no_leg(self._cockpit.telemetry) is not None
        return None if missing or self._deviations.waits else motion

    def vehicle_heard(self, telemetry: Telemetry) -> None:
        """The vehicle says how it is."""
        cockpit, handing = self._cockpit, self._handing
        cockpit.telemetry = telemetry
        cockpit.silent_s = 0.0
        self._silence.heard()
        if self._launch.note(telemetry):
            self._helm.custody.assume(FlightMode.MISSION)
        moved = self._deviations.home(telemetry) if telemetry.in_air else None
        if moved is not None:
            cockpit.say(moved.words)
        if self._launch.over(telemetry) and knows(cockpit.state, Signal.GROUNDED):
            self._grounded()
        elif self._taken(telemetry):
            return
        elif handing.waits:
            handing.check()
        elif cockpit.state is State.READY:
            self._take_off(telemetry)
            if moved is not None and moved.response is Response.HOLD and handing.in_charge:
                self._homecoming.come_home("home was moved in the climb")
        elif cockpit.state is State.PASSIVE:
            self._look_on(telemetry)
        elif handing.in_charge and self._fit(telemetry):
            self._keep(telemetry, moved)
            self._go_on(telemetry)

    def _taken(self, telemetry: Telemetry) -> bool:
        """Whether hands are off just now: it falls, or follows another's choice."""
        handing, killed = self._handing, self._launch.killed_now()
        if killed is not None:
            handing.fallen(killed)
            return True
        if not (handing.in_charge and self._helm.custody.taken(telemetry)):
            return False
        who = Taker.FAILSAFE if telemetry.failsafe else Taker.PILOT
        self._chosen = (telemetry.mode, self._cockpit.now_s)
        handing.take_over(who, f"{who.value} chose {telemetry.mode.value} mode")
        return True

    def _grounded(self) -> None:
        if self._patient and self._cockpit.state is State.READY and self._launch.again():
            self._cockpit.say("disarmed before take-off: waiting on")
        else:
            self._cockpit.signal(Signal.GROUNDED)

    def _take_off(self, telemetry: Telemetry) -> None:
        cockpit, custody = self._cockpit, self._helm.custody
        if self._launch.handed_over and telemetry.in_air:
            self._hear(telemetry)  # the climb ends above home by itself
            if cockpit.state is not State.READY:
                return
        stage = take_off(cockpit.mission, telemetry)
        if stage is TakeOff.COMPLETE:
            custody.assume(FlightMode.MISSION)
            self._launch.resumed(cockpit.now_s)
            cockpit.signal(Signal.AIRBORNE)
        elif stage in HELD and custody.pending is None:
            cockpit.say(f"holding: {HELD[stage]}")
            self._helm.command(HoldHere(stage.value))
        elif self._launch.stuck(telemetry) and custody.pending is None:
            self._homecoming.come_home("the climb does not go on")

    def _fit(self, telemetry: Telemetry) -> bool:
        """Whether the mission may go on: no breach, no other's orders, and all inputs."""
        helm = self._helm
        finding = self._watch.look(telemetry, helm.custody, self._renewal.leaving)
        match finding.sign:
            case Sign.STRANGER:
                self._handing.take_over(Taker.PILOT, finding.words)
            case Sign.BREACH:
                self._handing.give_up(f"{finding.words} is not resumed by itself")
        return finding.sign is Sign.GOOD and self._hear(telemetry)

    def _hear(self, telemetry: Telemetry) -> bool:
        """Whether enough of the vehicle is heard to fly on by; what is missing is told."""
        cockpit, helm = self._cockpit, self._helm
        outlook = self._inputs.look(telemetry)
        landing = cockpit.state is State.LAND  # PX4 does so without a position too
        for what, then in outlook.news:
            cockpit.say(f"{what}: {'landing on' if landing else then}" if then else what)
        if outlook.home_why is not None:
            self._homecoming.come_home(outlook.home_why)
        if cockpit.state is State.READY:
            return True
        if outlook.stop is Stop.NONE:
            if outlook.back:
                cockpit.schedule.retry_in(0.0)
            return True
        if outlook.stop is Stop.HOLD and not landing and self._may_try_again():
            helm.hold(outlook.why)  # unless that is what it does
        self._homecoming.check(telemetry)  # time and charge go on
        if cockpit.schedule.left_s == 0.0 and self._renewal.phase is None:
            cockpit.signal(Signal.TIMER)
        return False

    def _look_on(self, telemetry: Telemetry) -> None:
        """Another flies: tell what a pilot may not see, and who took it if that shows late."""
        cockpit, handing = self._cockpit, self._handing
        mode, taken_s = self._chosen or (telemetry.mode, -math.inf)
        late = telemetry.mode is mode and cockpit.now_s - taken_s <= LATE_S
        if telemetry.failsafe and late and handing.taken_by is Taker.PILOT:
            handing.taken_by = Taker.FAILSAFE
            cockpit.say(f"it was {Taker.FAILSAFE.value} that chose {mode.value} mode")
        for what, _ in self._inputs.look(telemetry).news:
            cockpit.say(what)
        news = self._breaches.news(self._watch.breach(telemetry), cockpit.now_s)
        if news is not None:
            cockpit.say(news)

    @property
    def _flies_mission(self) -> bool:
        """Whether it flies by our commands, above the ground, among zones that do not change."""
        grounding = self._cockpit.state in {State.READY, State.LAND}
        changing = self._renewal.phase is not None or self._levelling.climbs
        given = self._handing.waits or not self._handing.in_charge
        return not (grounding or changing or given)

    def _keep(self, telemetry: Telemetry, moved: Deviation | None) -> None:
        """Have it keep to what was planned; see `deviations`."""
        if not self._flies_mission:
            self._deviations.forget()
            return
        if moved is not None:
            self._respond(*moved, said=True)
        for deviation in self._deviations.look(telemetry, self._helm.custody):
            self._respond(*deviation)

    def _respond(self, response: Response, words: str, *, said: bool = False) -> None:
        cockpit = self._cockpit
        if response is Response.HOME and knows(cockpit.state, Signal.COME_HOME):
            self._homecoming.come_home(words)
            return
        holds = response in {Response.HOLD, Response.WAIT, Response.HOME}
        if not said:
            cockpit.say(f"{words}: holding" if holds else words)
        if holds:
            self._helm.hold(words)
        if response is not Response.TELL:
            cockpit.schedule.retry_in(0.0 if response is Response.BACK else HOLD_S)

    def _may_try_again(self) -> bool:
        """Whether nothing waits to be tried again, or its time has come."""
        schedule = self._cockpit.schedule
        return schedule.take_retry() or not schedule.retrying

    def _go_on(self, telemetry: Telemetry) -> None:
        """Home if it is time; then zones that change; then the state's timer, and its journey."""
        cockpit, helm = self._cockpit, self._helm
        self._exploration.passing(telemetry.position, cockpit.now_s)
        self._homecoming.check(telemetry)
        if self._renewal.go_on(telemetry):
            return
        if self._levelling.go_on(telemetry):
            if self._levelling.stuck:
                self._handing.give_up("the climb to the mission's altitude does not go on")
            return
        if self._deviations.waits:
            return
        if cockpit.schedule.left_s == 0.0:
            cockpit.signal(Signal.TIMER)
        self._answering.now_what_waited()
        helm.advance(helm.navigator.update(telemetry))
        if not helm.custody.pending and cockpit.schedule.take_retry():
            cockpit.journey.try_again()

    def item_reached(self, event: ItemReached) -> None:
        """The vehicle says that it is at a plan item: perhaps at the end of its leg."""
        telemetry, helm = self._cockpit.telemetry, self._helm
        if telemetry is None or not self._handing.in_charge or self._renewal.phase is not None:
            return
        if isinstance(helm.custody.pending, FlyToNode):
            return  # the report may be of the node before; the vehicle has not confirmed the jump
        node = self._plan.node_of(event.item)
        helm.advance(helm.navigator.update(telemetry, reached_node=node))

    def nothing_heard(self, event: LinkSilent) -> None:
        """The vehicle says nothing."""
        self._cockpit.silent_s = event.silent_s
        news = self._silence.news(event.silent_s)
        if news is not None:
            self._cockpit.say(news)

    def confirmed(self, event: CommandConfirmed) -> None:
        """It follows; if that was the hold before hands are off, it is let go."""
        self._helm.confirmed(event.action)
        self._handing.check()
