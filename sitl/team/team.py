"""The simulated world beside an autopilot, as a process: robots, radios, links and the camera.

Follows the truth stream of a vehicle (`sitl vehicle`, or a PX4 with its SIH simulator): its time is
the world's time, and its position decides who receives it and what its camera sees.
"""

import logging
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import zmq

from air_router.errors import AirRouterError
from air_router.messages import MessageError
from air_router.mission import Mission
from geo.frame import FrameError
from geo.grid import GridError, GridPatch
from mocha_link.lifetime import Closeable
from mocha_link.team import Team
from sitl.team.nodes import GroundNodes, RadioReadings, RosMessages, Rovers
from sitl.team.relay import Relay, relayed_pairs
from sitl.team.roles import check_rovers, roles_of
from sitl.team.team_report import TeamPace, report
from sitl.team.team_world import make_world
from sitl.team.truth import SimClock, TruthReceiver, VehicleState
from sitl.world import Step, Truth, WorldPlan

_log = logging.getLogger(__name__)

_STOP_CHECK_S = 0.1  # how often the loop checks for a stop while no truth comes
_EXCHANGE_CHECK_S = 0.002  # how often while it waits for robots in an exchange
_SILENCE_NOTE_S = 5.0
_FAR_FROM_HOME_M = 2000.0
_CAMERA_QUEUE = 100  # pictures kept for a companion that is slow to take them


class CameraError(AirRouterError):
    """The camera's pictures cannot be offered at their address; the message has a remedy."""


@dataclass(frozen=True, slots=True)
class Places:
    """Where the world listens for one vehicle: its truth stream, and its camera's subscribers."""

    truth: str = "udp://127.0.0.1:0"
    camera: str = "tcp://127.0.0.1:0"


class _Vehicle(Closeable):
    """What the world has to do with one vehicle.

    Attributes:
        truth: Where its position comes from.
        state: Its newest state; None: not received yet.
    """

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], places: Places) -> None:
        self.state: VehicleState | None = None
        with ExitStack() as stack:
            self.truth = TruthReceiver(places.truth)
            stack.callback(self.truth.close)
            self._camera = stack.enter_context(_publisher(context, places.camera))
            self._stack = stack.pop_all()

    def places(self) -> dict[str, str]:
        """Where it is listened to, and where its pictures are."""
        camera = self._camera.getsockopt_string(zmq.LAST_ENDPOINT)
        return {"truth": self.truth.url, "camera": camera}

    def listen(self, timeout_s: float) -> bool:
        """Renew `state`; whether something came in time."""
        state = self.truth.receive(timeout_s)
        self.state = state or self.state
        return state is not None

    def show(self, patch: GridPatch) -> None:
        """Publish what its camera sees."""
        self._camera.send(patch.encode())

    def close(self) -> None:
        """Free the ports."""
        self._stack.close()


class TeamSimulation(Closeable):
    """Carries out the steps of a `World` with real sockets. A context manager.

    Args:
        mission: What the vehicle flies.
        team: Who is who, and where they listen.
        plan: The world.
        places: Where to listen for each vehicle; for one that is missing at free ports.
        rovers: The robots that programs play, and where the node of each is served to its program.
        epoch_s: Unix time at the vehicle's time zero; None: such that the first packet of the truth
            stream comes at the present wall time.

    Attributes:
        world: The world.
        clock: Its time.

    Raises:
        TruthError, CameraError, RelayError, mocha_link.errors.MochaLinkError: something cannot
            listen where it should.
    """

    def __init__(  # noqa: PLR0913 - where each part of the world comes from
        self,
        mission: Mission,
        team: Team,
        plan: WorldPlan,
        places: Mapping[str, Places] | None = None,
        *,
        rovers: Mapping[str, str] | None = None,
        epoch_s: float | None = None,
    ) -> None:
        roles, rovers, places = roles_of(mission, team), rovers or {}, places or {}
        check_rovers(rovers, roles, team)
        self.world = make_world(mission, team, roles, plan, rovers)
        self.clock = SimClock(epoch_s)
        self._ros_messages = RosMessages(team)
        self._mission = mission
        self._team = team
        self._pace = TeamPace()
        # Without a limit of rate they take the wall's time only: it waits until they are over.
        self._awaits_exchanges = plan.radio.rate_bytes_s is None
        self._ground_amsl_m = mission.home_altitude_amsl_m  # None: where the vehicle is first
        self._greeted = False  # its truth was received, and its distance from home checked
        with ExitStack() as stack:
            context: zmq.Context[zmq.Socket[bytes]] = stack.enter_context(zmq.Context())
            self._vehicles = {
                name: stack.enter_context(_Vehicle(context, places.get(name, Places())))
                for name in roles.vehicles
            }
            self._first = self._vehicles[roles.vehicles[0]]  # whose time is the world's
            self._radio = stack.enter_context(RadioReadings(team))
            self._relay = stack.enter_context(
                Relay(
                    relayed_pairs(team),
                    rate_bytes_s=plan.radio.rate_bytes_s,
                    now_s=self.clock.now_s,
                )
            )
            self._nodes = stack.enter_context(GroundNodes(team, self.world.robots, self.clock))
            self._rovers = stack.enter_context(
                Rovers(team, mission.frame, self._nodes.nodes, rovers)
            )
            self._stack = stack.pop_all()

    def ready(self) -> dict[str, Any]:
        """What others need to know to take part."""
        return {
            "ready": True,
            "team": str(self._team.path),
            **self._first.places(),
            "vehicle": self.world.vehicles[0],
            "robots": list(self.world.robots),
            "vehicles": {name: vehicle.places() for name, vehicle in self._vehicles.items()},
        }

    def run(
        self,
        stopped: Callable[[], bool],
        reached: Callable[[float], None] = lambda _time_s: None,
    ) -> None:
        """Follow the vehicle until `stopped` is true.

        `reached` is called with the second of the vehicle's clock up to which the world has moved
        on and the robots' exchanges have ended: without a limit of rate these take the wall's
        time only.
        """
        received_s = time.monotonic()
        silent = False
        worked_s: float | None = None  # of the vehicle's clock; None: all of it is reported
        while not stopped():
            if worked_s is not None and not (self._awaits_exchanges and self._nodes.exchanging):
                reached(worked_s)
                worked_s = None
            received = self._first.listen(_STOP_CHECK_S if worked_s is None else _EXCHANGE_CHECK_S)
            state = self._first.state
            if received and state is not None:
                received_s, silent = time.monotonic(), False
                for vehicle in self._vehicles.values():
                    if vehicle is not self._first:
                        vehicle.listen(0.0)
                self.follow(state)
                worked_s = state.time_s
            elif not silent and time.monotonic() - received_s > _SILENCE_NOTE_S:
                silent = True
                _log.warning(
                    "no truth packets on %s: waiting for the vehicle; start it, or give --truth",
                    self._first.truth.url,
                )

    def follow(self, state: VehicleState) -> None:
        """Move the world on to a new state of the vehicle."""
        self._first.state = state
        self.clock.advance(state.time_s)
        if not self.world.due(self.clock.elapsed_s):
            return
        if self._ground_amsl_m is None:
            self._ground_amsl_m = state.altitude_amsl_m
        truths = {
            name: truth
            for name, vehicle in self._vehicles.items()
            if (truth := self._truth_of(vehicle.state, self._ground_amsl_m)) is not None
        }
        truth = truths.get(self.world.vehicles[0])
        if truth is None:
            return  # the next packet will be better
        self._pace.stepped(truth.time_s, time.monotonic())
        if not self._greeted:
            self._greeted = True
            self._greet(truth)
        for name, place in self._rovers.places(truth.unix_s):
            self.world.stand(name, place)
        self._apply(self.world.step(truths))

    def _truth_of(self, state: VehicleState | None, ground_amsl_m: float) -> Truth | None:
        """Where a vehicle is now; None: not known, or on the far side of the Earth."""
        if state is None:
            return None
        try:
            position = self._mission.frame.to_local(state.latitude_deg, state.longitude_deg)
        except FrameError:
            return None
        return Truth(
            time_s=self.clock.elapsed_s,
            unix_s=self.clock.now_s(),
            position=position,
            height_m=state.altitude_amsl_m - ground_amsl_m,
            heading_deg=state.heading_deg,
        )

    def report(self) -> Mapping[str, Any]:
        """What became of all robots so far."""
        self._deliver()
        found = report(self.world, self._nodes, self.clock)
        return {**found, "pace": self._pace.as_json()}

    def close(self) -> None:
        """Stop nodes, relays and sockets."""
        self._stack.close()

    def _apply(self, step: Step) -> None:
        for change in step.links:
            self._relay.set_link(change.a, change.b, up=change.up)
            _log.info("%s and %s %s", change.a, change.b, "in contact" if change.up else "lost")
        self._radio.send_readings(step.readings)
        self._nodes.publish(map(self._ros_messages.of, step.publications))
        self._deliver()
        for name, patch in step.patches.items():
            self._vehicles[name].show(patch)

    def _deliver(self) -> None:
        """Deliver to robots the messages that have reached their nodes."""
        for name, message in self._nodes.arrived():
            try:
                self.world.receive(name, message.robot, message.topic, message.data)
            except (MessageError, GridError, FrameError) as error:
                _log.warning("%s of %s: %s", message.topic, message.robot, error)

    def _greet(self, truth: Truth) -> None:
        _log.info("the vehicle is there, at %.1f s of its time", truth.time_s)
        home = self._mission.home
        away_m = max(
            abs(truth.position.east_m - home.east_m), abs(truth.position.north_m - home.north_m)
        )
        if away_m > _FAR_FROM_HOME_M:
            _log.warning(
                "the vehicle is %.0f km from the mission's home: no robot is in range; start it "
                "at the mission's home",
                away_m / 1000,
            )


def _publisher(context: zmq.Context[zmq.Socket[bytes]], url: str) -> zmq.Socket[bytes]:
    camera = context.socket(zmq.PUB)
    camera.linger = 0
    camera.sndhwm = _CAMERA_QUEUE
    try:
        camera.bind(url)
    except zmq.ZMQError as error:
        camera.close()
        raise CameraError(
            f"cannot offer the camera's pictures at {url}: {error.strerror}; end the other "
            "simulation, or give --camera tcp://127.0.0.1:0 for a free port"
        ) from None
    return camera
