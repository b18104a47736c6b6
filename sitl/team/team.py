"""The simulated world beside an autopilot, as a process: robots, radios, links and the camera.

Follows the truth stream of a vehicle (`sitl vehicle`, or a PX4 with its SIH simulator): its time is
the world's time, and its position decides who hears it and what its camera sees.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any, Final

import zmq

from air_router.errors import AirRouterError, ExitCode
from air_router.gossip.mapper import RESOLUTION_M
from air_router.mission.found_by import UAV_KIND
from air_router.mission.mission import Mission
from geo.frame import FrameError
from mocha_link.node.lifetime import Closeable
from mocha_link.team.team import Team
from sitl.mavlink.truth import TruthReceiver, VehicleState
from sitl.team.clock import SimClock
from sitl.team.ground_nodes import GroundNodes, RadioReadings
from sitl.team.relay import Relay, relayed_pairs
from sitl.team.rovers import RosMessages, Rovers
from sitl.team.team_report import Holdings, TeamPace, report
from sitl.world.terrain import Raster
from sitl.world.ugv import GroundRobot
from sitl.world.world import Settings, Step, Truth, World
from sitl.world.world_file import WorldPlan

_log = logging.getLogger(__name__)

DEFAULT_TRUTH: Final = "udp://127.0.0.1:19410"
DEFAULT_CAMERA: Final = "tcp://127.0.0.1:24600"

_STOP_LOOK_S = 0.1  # how often the loop looks whether it should stop, while no truth comes
_SILENCE_NOTE_S = 5.0
_FAR_FROM_HOME_M = 2000.0
_CAMERA_QUEUE = 100  # pictures kept for a companion that is slow to take them


class CameraError(AirRouterError):
    """The camera's pictures cannot be offered where they should; the message says what to do."""


class TeamError(AirRouterError):
    """The team does not fit the mission; the message says how."""

    exit_code = ExitCode.INVALID_FILE


@dataclass(frozen=True, slots=True)
class Places:
    """Where the world listens: the vehicle's truth stream and the camera's subscribers.

    `others` are the same of the other vehicles, by name. `rovers` are the robots that programs
    play, and where the node of each is served to its program.
    """

    truth: str = DEFAULT_TRUTH
    camera: str = DEFAULT_CAMERA
    others: Mapping[str, Places] = field(default_factory=dict)
    rovers: Mapping[str, str] = field(default_factory=dict)


_ANYWHERE: Final = Places("udp://127.0.0.1:0", "tcp://127.0.0.1:0")


@dataclass(frozen=True, slots=True)
class TeamRoles:
    """Who is who in a team: the vehicle that flies the mission, and the robots on the ground.

    `others` are the other vehicles of a mission for several.
    """

    vehicle: str
    ground: tuple[str, ...]
    others: tuple[str, ...] = ()


def roles_of(mission: Mission, team: Team) -> TeamRoles:
    """Who flies and who drives. Aerial robots that the mission is not for are not simulated.

    Raises:
        TeamError: it is not clear who flies, or no robot drives.
    """
    flying = [name for name, robot in team.robots.items() if robot.kind == UAV_KIND]
    vehicle = mission.uav
    if vehicle is None and len(flying) == 1:
        vehicle = flying[0]
    if vehicle is None or vehicle not in team.robots:
        raise TeamError(
            f"{team.path}: which robot flies this mission? set 'uav' in the mission to one of "
            f"{', '.join(team.robots)}"
        )
    ground = tuple(name for name in team.robots if name != vehicle and name not in flying)
    if not ground:
        raise TeamError(f"{team.path}: no robot drives on the ground; add a robot of another kind")
    return TeamRoles(vehicle, ground, tuple(u.uav for u in mission.layers if u.uav != vehicle))


def make_world(
    mission: Mission,
    team: Team,
    roles: TeamRoles,
    plan: WorldPlan,
    played: Collection[str] = (),
) -> World:
    """The pure world of a mission: robots at the start of their patrols.

    Those that are `played` by programs stand there, and say nothing by themselves.
    """
    corners = [corner for fence in mission.fences for corner in fence.corners]
    corners += [*(waypoint.position for waypoint in mission.waypoints), mission.home]
    settings = Settings(
        frame=mission.frame,
        vehicle=roles.vehicle,
        others=roles.others,
        radio=plan.radio,
        camera=plan.camera,
        raster=Raster.draw(plan.scene, corners, RESOLUTION_M, plan.margin_m),
        camera_interval_s=plan.picture_interval_s,
        reading_interval_s=plan.reading_interval_s,
    )
    robots = {
        name: GroundRobot(name, p.patrol, p.speed_m_s, plan.scene.vehicles, p.start_m)
        for name, p in plan.patrols.items()
    }
    speech = RosMessages(team)
    topics = {name: () if name in played else speech.topics(name) for name in robots}
    for name in played:
        robots[name].stand(robots[name].position)
    return World(settings, robots, topics)


class TeamSimulation(Closeable):
    """Carries out what a `World` says, with real sockets. A context manager.

    Args:
        mission: What the vehicle flies.
        team: Who is who, and where they listen.
        plan: The world.
        places: Where to listen.
        epoch_s: Unix time at the vehicle's time zero; None: such that the first packet of the truth
            stream comes at the present wall time.

    Raises:
        TruthError, CameraError, RelayError, mocha_link.errors.MochaLinkError: something cannot
            listen where it should.
    """

    def __init__(
        self,
        mission: Mission,
        team: Team,
        plan: WorldPlan,
        places: Places,
        *,
        epoch_s: float | None = None,
    ) -> None:
        roles = roles_of(mission, team)
        rovers = places.rovers
        if strangers := sorted(rovers.keys() - set(roles.ground)):
            raise TeamError(
                f"{team.path}: no robot '{strangers[0]}' drives on the ground for a program to "
                f"play; use one of {', '.join(roles.ground)}"
            )
        self.world = make_world(mission, team, roles, plan, rovers)
        self._speech = RosMessages(team)
        self.clock = SimClock(epoch_s)
        self._mission = mission
        self._team = team
        self._pace = TeamPace()
        self._ground_amsl_m = mission.home_altitude_amsl_m  # None: where the vehicle is first
        self._greeted = False  # the vehicle was heard, and how far from home it is was looked at
        self._others: dict[str, VehicleState] = {}  # as heard last
        with ExitStack() as stack:
            self._truth = TruthReceiver(places.truth)
            stack.callback(self._truth.close)
            context: zmq.Context[zmq.Socket[bytes]] = stack.enter_context(zmq.Context())
            self._camera = stack.enter_context(_publisher(context, places.camera))
            self._other_truths: dict[str, TruthReceiver] = {}
            self._other_cameras: dict[str, zmq.Socket[bytes]] = {}
            for name in roles.others:
                place = places.others.get(name) or _ANYWHERE
                self._other_truths[name] = receiver = TruthReceiver(place.truth)
                stack.callback(receiver.close)
                self._other_cameras[name] = stack.enter_context(_publisher(context, place.camera))
            self._radio = stack.enter_context(RadioReadings(team))
            self._relay = stack.enter_context(
                Relay(
                    relayed_pairs(team),
                    rate_bytes_s=plan.rate_bytes_s,
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
            "camera": self._camera.getsockopt_string(zmq.LAST_ENDPOINT),
            "truth": self._truth.url,
            "vehicle": self.world.settings.vehicle,
            "robots": list(self.world.robots),
            "vehicles": {
                self.world.settings.vehicle: _place(self._truth, self._camera),
                **{
                    name: _place(truth, self._other_cameras[name])
                    for name, truth in self._other_truths.items()
                },
            },
        }

    def run(
        self,
        stopped: Callable[[], bool],
        reached: Callable[[float], None] = lambda _time_s: None,
    ) -> None:
        """Follow the vehicle until `stopped` says so.

        `reached` is told up to which second of the vehicle's clock the world has been moved on.
        """
        heard_s = time.monotonic()
        silent = False
        while not stopped():
            state = self._truth.receive(_STOP_LOOK_S)
            if state is not None:
                heard_s, silent = time.monotonic(), False
                for name, receiver in self._other_truths.items():
                    if (other := receiver.receive(0.0)) is not None:
                        self._others[name] = other
                self.follow(state)
                reached(state.time_s)
            elif not silent and time.monotonic() - heard_s > _SILENCE_NOTE_S:
                silent = True
                _log.warning(
                    "no truth packets on %s: waiting for the vehicle; start it, or give --truth",
                    self._truth.url,
                )

    def follow(self, state: VehicleState) -> None:
        """Move the world on to a new state of the vehicle."""
        self.clock.advance(state.time_s)
        if not self.world.due(self.clock.elapsed_s):
            return
        if self._ground_amsl_m is None:
            self._ground_amsl_m = state.altitude_amsl_m
        truth = self._truth_of(state, self._ground_amsl_m)
        if truth is None:
            return  # the next packet will be better
        self._pace.stepped(truth.time_s, time.monotonic())
        if not self._greeted:
            self._greeted = True
            self._greet(truth)
        others = {
            name: other
            for name, there in self._others.items()
            if (other := self._truth_of(there, self._ground_amsl_m)) is not None
        }
        for name, place in self._rovers.places(truth.unix_s):
            self.world.robots[name].stand(place)
        self._apply(self.world.step(truth, others))

    def _truth_of(self, state: VehicleState, ground_amsl_m: float) -> Truth | None:
        """Where a vehicle is now; None if that is on the far side of the Earth."""
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
        self._nodes.take_maps()
        holdings = Holdings(self._nodes.messages(), self._nodes.links(), self._nodes.keepers)
        now_s = self.clock.now_s()
        told = report(self.world, holdings, now_s=now_s, elapsed_s=self.clock.elapsed_s)
        return {**told, "pace": self._pace.told()}

    def close(self) -> None:
        """Stop nodes, relays and sockets."""
        self._stack.close()

    def _apply(self, step: Step) -> None:
        for change in step.links:
            self._relay.set_link(change.a, change.b, up=change.up)
            _log.info("%s and %s %s", change.a, change.b, "in contact" if change.up else "lost")
        self._radio.tell(step.readings)
        self._nodes.publish(map(self._speech.of, step.publications))
        self._nodes.take_maps()
        if step.patch is not None:
            self._camera.send(step.patch.encode())
        for name, patch in step.other_patches:
            self._other_cameras[name].send(patch.encode())

    def _greet(self, truth: Truth) -> None:
        _log.info("the vehicle is there, at %.1f s of its time", truth.time_s)
        home = self._mission.home
        away_m = max(
            abs(truth.position.east_m - home.east_m), abs(truth.position.north_m - home.north_m)
        )
        if away_m > _FAR_FROM_HOME_M:
            _log.warning(
                "the vehicle is %.0f km from the mission's home: no robot will hear it; start it "
                "at the mission's home",
                away_m / 1000,
            )


def _place(truth: TruthReceiver, camera: zmq.Socket[bytes]) -> dict[str, str]:
    return {"truth": truth.url, "camera": camera.getsockopt_string(zmq.LAST_ENDPOINT)}


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
