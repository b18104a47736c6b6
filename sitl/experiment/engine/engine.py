"""One run of an experiment: a town full of robots in simulated time, from its settings and a seed.

    run = Run(settings, seed)
    run.finish()

Nothing here reads a clock to decide anything, nothing depends on the order of a set or a hash, and
all chance comes from the seed. The same seed gives the same event log on another machine as far as
both round alike: floats are IEEE 754 doubles everywhere; what logarithms and the functions of
angles of another C library may give differently in the last bit is rounded away (times to a
microsecond, positions to a millimetre) before anything is decided by it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np

from air_router.controller.motion import REACTION_S
from air_router.messages import MAP_TOPIC
from air_router.seek_policies import Policy
from geo.frame import Point
from geo.grid import Terrain
from mocha_link.links import LinkEvent, MessageStored
from sitl.experiment import ORACLES, EventLog, EventQueue, RunSettings
from sitl.experiment.engine.ages import Ages, Held, Pair
from sitl.experiment.engine.channel import (
    Channel,
    LinkedChannel,
    PaperChannel,
    PathLossChannel,
)
from sitl.experiment.engine.channel_sim import ChannelSim
from sitl.experiment.engine.exchange import AirtimeStats, ContactInterval
from sitl.experiment.engine.link_scores import LinkScores
from sitl.experiment.robots import (
    CAMERA,
    COMMAND_S,
    NO_POLICIES,
    MapPainter,
    Node,
    Uav,
    base_messages,
    controllers_of,
    fleet_of,
    scenery_of,
)
from sitl.world import HIGHEST_M
from sitl.world.explorers import (
    CLAIMS_TOPIC,
    NO_VEHICLE_M,
    Exploration,
    ExplorerSettings,
    GroundRobot,
    Visit,
)
from sitl.world.towns import GRAIN_M, PASSABLE, REACHED_M, Town, Ways, scatter

GROUND_S: Final = 1.0
"""Ground robots drive and think in steps of this."""

ORACLE_S: Final = 2.0
"""An oracle publishes the robots' positions so often."""

GROUND_ANTENNA_M: Final = 0.5

MOST_TELEMETRY_S: Final = REACTION_S - COMMAND_S
"""A motion that is on its way to the vehicle for `COMMAND_S` would be from too old a position."""


class Run:
    """A run: put together by its settings and a seed, carried out by `finish`.

    Args:
        settings: The team, the channel, the protocol.
        seed: Makes all that is random.
        policies: Of UAVs, by name, in the place of that of the settings.

    Raises:
        AirRouterError: files of the settings are not what they should be.
        ValueError: settings that no run can be made of; the message has them.

    Attributes:
        settings: The team, the channel, the protocol.
        queue: The clock.
        town: Where it happens, with the goals of this run.
        log: Of everything that was decided; its digest is the run's.
        fleet: Who takes part; by its `names` robots have their numbers.
        robots: The ground robots, by name.
        uavs: The UAVs.
        ages: Follows what robots know of each other.
        nodes: Of all robots, by number.
        airtime: What was on the air.
        channel_sim: Connects the nodes.
        link_scores: Judges models of links; None: that was not requested.
        travelled_m: How far each robot has come over ground, by number.
        goal_bound_share: At most this share of the goals can be reached, in the mean over time.
        held: What robots held of each other, when it is over.
        wall_s, cpu_s: What it took, when it is over.
    """

    held: dict[Pair, Held]
    wall_s: float
    cpu_s: float
    goal_bound_share: float

    def __init__(
        self, settings: RunSettings, seed: int, policies: Mapping[str, Policy] = NO_POLICIES
    ) -> None:
        self._began = time.perf_counter(), time.process_time()  # wall, CPU seconds
        _check(settings)
        self.settings = settings
        self.queue = EventQueue()
        scenery = scenery_of(settings, seed)
        self.town = scenery.town
        if settings.goals == "seed" and settings.blocks is None:  # no route depends on them
            self.town = scatter(scenery.town, seed, len(scenery.town.goals))
        self.log = EventLog(self.queue)
        self.fleet = fleet_of(
            settings.uavs,
            settings.ugvs,
            base=settings.base_station,
            original=settings.protocol == "original",
        )
        self._numbers = {name: number for number, name in enumerate(self.fleet.names)}
        who, drawn = (self.town, self.fleet.ugvs, seed), settings.starts == "seed"
        self.robots = Exploration(*who, settings.explorer, drawn_starts=drawn).robots()
        self._starts = [robot.position for robot in self.robots.values()]
        origin, raster = self.town.frame.origin, self.town.raster
        painters = {name: MapPainter(origin, raster, CAMERA) for name in self.fleet.uavs}
        maps = {name: painter.grid for name, painter in painters.items()}
        made = controllers_of(self.fleet, settings, scenery, policies, maps)
        self.uavs = [
            Uav(
                *(name, scenery.mission, scenery.plan, settings, self.queue, self.log, controller),
                painters[name],
            )
            for name, controller in made.items()
        ]
        self.ages = Ages(self.queue)
        for uav in self.uavs:
            self.ages.watch(uav.name, MAP_TOPIC, partial(getattr, uav.painter, "known_cells"))
        for name, robot in self.robots.items():
            self.ages.watch(name, CLAIMS_TOPIC, robot.book.claims.copy)
        self.nodes = [self._node(*each) for each in enumerate(self.fleet.names)]
        self._places = np.zeros((len(self.nodes), 3))  # east, north, up in m, by number
        self._places[:] = (*self.town.home, GROUND_ANTENNA_M)
        for uav in self.uavs:
            uav.node = self.nodes[self._numbers[uav.name]]
            self._locate(uav)
        for name, robot in self.robots.items():
            self._places[self._numbers[name], :2] = robot.position
        self.travelled_m = np.zeros(len(self.nodes))
        self.airtime = AirtimeStats(self.log.sent)
        channel: Channel = PaperChannel(settings.paper, settings.radius_m, len(self.nodes), seed)
        if settings.linked:
            channel = LinkedChannel(self._numbers[self.fleet.uavs[0]], len(self.nodes))
        elif settings.channel == "path_loss":
            channel = PathLossChannel(settings.path_loss, self.town, self.fleet.names, seed)
        self.channel_sim = ChannelSim(self.queue, channel, self.nodes, self.airtime)
        self.link_scores = LinkScores(self.channel_sim.in_contact) if settings.link_scores else None
        self._known_sum = 0.0  # of the town in the first UAV's map, 0..1, at each step
        self._known_count = 0  # of these steps
        self._goals: dict[str, Visit] = {}  # first visits, by goal
        self._counted = dict.fromkeys(self.fleet.ugvs, 0)  # of its `visited`
        self._ground_at_s = 0.0  # simulated time of the ground robots' next step

    def finish(self) -> None:
        """Let it run to its end."""
        settings, queue = self.settings, self.queue
        queue.every(settings.telemetry_s, self._tick)
        queue.run(settings.duration_s)
        self.held = self.ages.held(self.fleet.names, self.fleet.kinds)
        self.goal_bound_share = goal_bound_share(
            self.town, self._starts, settings.explorer, settings.duration_s
        )
        wall_s, cpu_s = self._began
        self.wall_s, self.cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s

    @property
    def map_known_share(self) -> float:
        """How much of the town the first UAV's map shows, 0..1, in the mean over time."""
        return self._known_sum / self._known_count if self._known_count else 0.0

    @property
    def goals(self) -> list[Visit]:
        """The goals that were reached, in order of time."""
        return sorted(self._goals.values(), key=lambda visit: (visit.time_s, visit.goal))

    @property
    def faults(self) -> dict[str, str]:
        """What went wrong in policies of other packages, by whose policy it was."""
        found = {uav.name: uav.controller.seek_fault for uav in self.uavs}
        found |= {name: robot.policy_fault for name, robot in self.robots.items()}
        return {name: fault for name, fault in found.items() if fault is not None}

    @property
    def contacts(self) -> list[ContactInterval]:
        """Who met whom, in the order of the beginnings."""
        return self.channel_sim.contacts()

    # Who takes part.

    def _node(self, number: int, name: str) -> Node:
        make = partial(
            Node,
            *(number, name, self.fleet.team, self.queue),
            triggered=self.settings.pulls == "node",
        )
        if name == self.fleet.base:
            return make(publish=partial(base_messages, self.town, self.queue))
        if name in self.robots:
            publish, receive = self.robots[name].outbox, self._receiver(name)
        else:
            uav = next(each for each in self.uavs if each.name == name)
            publish, receive = uav.outbox, uav.receive
        return make(publish=publish, receive=self.ages.listener(name, receive))

    def _receiver(self, name: str) -> Callable[[LinkEvent], None]:
        """What a ground robot does with what happens on its links."""
        robot, number = self.robots[name], self._numbers[name]

        def receive(event: LinkEvent) -> None:
            if isinstance(event, MessageStored) and event.robot != name:
                data = self.nodes[number].data_of(event)
                robot.take(event.robot, event.topic, data, self.queue.now_s)

        return receive

    # What happens.

    def _tick(self) -> None:
        now_s = self.queue.now_s
        before = self._places[:, :2].copy()
        for uav in self.uavs:
            uav.tick()
            self._locate(uav)
        if now_s >= self._ground_at_s:
            self._ground_at_s += GROUND_S
            for name, robot in self.robots.items():
                robot.step(now_s)
                self._places[self._numbers[name], :2] = robot.position
                self._count_goals(name, robot)
                if self.settings.policy in ORACLES and now_s % ORACLE_S < GROUND_S:
                    for uav in self.uavs:
                        uav.see(name, robot.position)
        self.travelled_m += np.sqrt(((self._places[:, :2] - before) ** 2).sum(axis=1))
        if self.uavs:
            self._known_sum += self.uavs[0].painter.known_share
            self._known_count += 1
        self.ages.update()
        self.channel_sim.settle()
        self.channel_sim.update(self._places)
        if self.link_scores is not None:
            ground = {name: self._numbers[name] for name in self.robots}
            flown = {self._numbers[uav.name]: uav for uav in self.uavs if uav.flies}
            self.link_scores.update(now_s, flown, ground, self._places)

    def _locate(self, uav: Uav) -> None:
        self._places[self._numbers[uav.name]] = (
            *uav.flyer.position,
            max(uav.flyer.altitude_m, GROUND_ANTENNA_M),
        )

    def _count_goals(self, name: str, robot: GroundRobot) -> None:
        for visit in robot.visited[self._counted[name] :]:
            if visit.goal not in self._goals:
                self._goals[visit.goal] = visit
                self.log.goal(visit.goal, name)
        self._counted[name] = len(robot.visited)


def _check(settings: RunSettings) -> None:
    if settings.uavs + settings.ugvs + settings.base_station == 0:
        raise ValueError("no robot takes part; set uavs, ugvs or base_station")
    if settings.linked and not settings.uavs:
        raise ValueError("'linked' is contact with the first UAV; set uavs")
    if settings.path_loss.air != "log_distance" and settings.uav_altitude_m > HIGHEST_M:
        raise ValueError(f"'air' of 3GPP is for UAVs up to {HIGHEST_M:g} m; lower uav_altitude_m")
    if not 0 < settings.telemetry_s <= MOST_TELEMETRY_S:
        raise ValueError(
            f"telemetry_s of {settings.telemetry_s:g}; nothing is commanded from positions older "
            f"than {MOST_TELEMETRY_S:g} s"
        )


def goal_bound_share(
    town: Town, starts: Sequence[Point], explorer: ExplorerSettings, duration_s: float
) -> float:
    """At most this share of the goals is reached, in the mean over the run, by any policy.

    A relaxation. Robots know the whole town and all goals from the start, drive as fast on every
    ground as on a road, and share the goals out as is best. A robot's first goal costs it its way
    there; each further one at least the straight way from the nearest other goal. So a slot, the
    j-th goal of a robot, has an earliest time for every goal, and the best assignment of slots to
    goals is the bound.

    Args:
        town: Where the goals are.
        starts: Where robots start.
        explorer: How fast they drive.
        duration_s: Of the run.
    """
    goals = [goal.position for goal in town.goals]
    if not goals or not starts:
        return 0.0
    reach_m = REACHED_M + NO_VEHICLE_M
    lattice = town.lattice
    ground = np.where(PASSABLE[town.ground], np.uint8(Terrain.ROAD), np.uint8(Terrain.BUILDING))
    near = [lattice.near(goal, reach_m) for goal in goals]
    first_m = np.array(
        [
            [min(costs[cells]) for cells in near]
            for costs in (Ways(lattice, ground, lattice.cell(start)).costs for start in starts)
        ]
    )
    first_m = np.maximum(first_m - GRAIN_M, 0.0)  # [robot, goal]
    hops_m = np.array(
        [
            max(min((math.dist(a, b) for b in goals if b != a), default=0.0) - 2 * reach_m, 0.0)
            for a in goals
        ]
    )
    before_m = np.concatenate(([0.0, 0.0], np.cumsum(np.sort(hops_m))))[: len(goals)]
    later_m = first_m.min(axis=1)[:, None, None] + before_m[:, None] + hops_m  # [robot, slot, goal]
    later_m[:, 0] = 0.0
    due_s = np.maximum(first_m[:, None], later_m) / (explorer.speed_m_s * explorer.progress)
    worth = np.maximum(1 - due_s / duration_s, 0.0).reshape(-1, len(goals))
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - what takes its time

    return float(worth[linear_sum_assignment(worth, maximize=True)].sum()) / len(goals)
