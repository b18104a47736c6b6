"""What each word of the vehicle leads to, and in which order: take-off, hands off, flying on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from air_router.actions import FlyToNode, HoldHere, Motion, Taker
from air_router.behaviour import Signal, State, knows
from air_router.deviations import Deviation, Response
from air_router.milestones import HELD, Silence, TakeOff, take_off
from air_router.vehicle import FlightMode
from air_router.watch import Sign

if TYPE_CHECKING:
    from air_router.answering import Answering
    from air_router.cockpit import Cockpit
    from air_router.deviations import Deviations
    from air_router.events import CommandConfirmed
    from air_router.exploration import Exploration
    from air_router.flight_plan import FlightPlan
    from air_router.handing import Handing
    from air_router.helm import Helm
    from air_router.homecoming import Homecoming
    from air_router.launch import Launch
    from air_router.levelling import Levelling
    from air_router.renewal import Renewal
    from air_router.vehicle import ItemReached, LinkSilent, Telemetry
    from air_router.watch import Watch


HOLD_S: Final = 2.0
"""A vehicle that holds for a deviation stands after so long, and goes on."""


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
        self._handing = handing
        self._homecoming = homecoming
        self._renewal = renewal
        self._levelling = levelling
        self._answering = answering
        self._patient = patient
        self._silence = Silence()

    def wait_for_fix(self, motion: Motion) -> Motion | None:
        """A guard: a vehicle that does not know where it is, or how high, is sent nowhere."""
        if self._watch.without_fix(self._cockpit.telemetry) or self._deviations.waits:
            return None
        return motion

    def vehicle_heard(self, telemetry: Telemetry) -> None:
        """The vehicle says how it is."""
        cockpit, handing, custody = self._cockpit, self._handing, self._helm.custody
        cockpit.telemetry = telemetry
        cockpit.silent_s = 0.0
        if self._launch.note(telemetry):
            custody.assume(FlightMode.MISSION)
        moved = self._deviations.home(telemetry) if telemetry.in_air else None
        if moved is not None:
            cockpit.say(moved.words)
        if self._launch.over(telemetry) and knows(cockpit.state, Signal.GROUNDED):
            self._grounded()
        elif handing.in_charge and custody.taken(telemetry):
            who = Taker.FAILSAFE if telemetry.failsafe else Taker.PILOT
            handing.take_over(who, f"{who.value} chose {telemetry.mode.value} mode")
        elif handing.waits:
            handing.check()
        elif cockpit.state is State.READY:
            self._take_off(telemetry)
            if moved is not None and moved.response is Response.HOLD and handing.in_charge:
                self._homecoming.come_home("home was moved in the climb")
        elif handing.in_charge and self._fit(telemetry):
            self._keep(telemetry, moved)
            self._go_on(telemetry)

    def _grounded(self) -> None:
        if self._patient and self._cockpit.state is State.READY and self._launch.again():
            self._cockpit.say("disarmed before take-off: waiting on")
        else:
            self._cockpit.signal(Signal.GROUNDED)

    def _take_off(self, telemetry: Telemetry) -> None:
        cockpit, custody = self._cockpit, self._helm.custody
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
        """Whether the mission may go on: no breach, nobody else's orders, and a position."""
        cockpit, helm = self._cockpit, self._helm
        landing = cockpit.state is State.LAND
        finding = self._watch.look(telemetry, helm.custody, self._renewal.leaving)
        match finding.sign:
            case Sign.STRANGER:
                self._handing.take_over(Taker.PILOT, finding.words)
            case Sign.BREACH:
                self._handing.give_up(f"{finding.words} is not resumed by itself")
            case Sign.LOST if landing:  # PX4 does so without a position too
                cockpit.say("GPS has lost its fix: landing on")
            case Sign.LOST:
                helm.hold(finding.words)
                cockpit.say(finding.words)
            case Sign.BLIND if not landing and self._may_try_again():
                helm.hold("GPS has no fix")  # unless that is what it does
            case Sign.BACK:
                cockpit.say(finding.words)
                cockpit.schedule.retry_in(0.0)
        return finding.sign in {Sign.GOOD, Sign.BACK}

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
