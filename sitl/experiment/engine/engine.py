"""One run of an experiment: a town full of robots in simulated time, from its settings and a seed.

    result = run(settings, seed)

Nothing here reads a clock to decide anything, nothing depends on the order of a set or a hash, and
all chance comes from the seed. The same seed gives the same event log on another machine as far as
both round alike: floats are IEEE 754 doubles everywhere; what logarithms and the functions of
angles of another C library may give differently in the last bit is rounded away (times to a
microsecond, positions to a millimetre) before anything is decided by it.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle, islice
from typing import Final

import numpy as np
import numpy.typing as npt

from air_router.controller.motion.command_gate import REACTION_S
from air_router.messages import MAP_TOPIC
from geo.frame import Point
from mocha_link.links.link_events import LinkEvent, MessageStored
from sitl.experiment.engine.ages import Ages
from sitl.experiment.engine.bound import goal_bound_share
from sitl.experiment.engine.channel import Channel, PaperChannel, PathLossChannel
from sitl.experiment.engine.channel_sim import ChannelSim
from sitl.experiment.engine.exchange import AirtimeStats
from sitl.experiment.engine.result import GoalVisit, RunResult
from sitl.experiment.events import EventLog, EventQueue
from sitl.experiment.robots.explorer import GroundRobot
from sitl.experiment.robots.messages import CLAIMS_TOPIC
from sitl.experiment.robots.node import Node, base_says, fleet_of
from sitl.experiment.robots.scenery import Scenery, scenery_of
from sitl.experiment.robots.uav import CAMERA, COMMAND_S, MapPainter, Uav, controllers_of
from sitl.experiment.settings import RunSettings
from sitl.world.towns.town import Town
from sitl.world.towns.town_generator import drawn_starts, scatter

GROUND_S: Final = 1.0
"""Ground robots drive and think in steps of this."""

ORACLE_S: Final = 2.0
"""An oracle tells so often where robots are."""

GROUND_ANTENNA_M: Final = 0.5

MOST_TELEMETRY_S: Final = REACTION_S - COMMAND_S
"""A motion that is on its way to the vehicle for `COMMAND_S` would be from too old a position."""


def run(settings: RunSettings, seed: int) -> RunResult:
    """Make one run.

    Args:
        settings: The team, the channel, the protocol.
        seed: All chance follows from it.

    Raises:
        AirRouterError: files of the settings are not what they should be.
        ValueError: settings that no run can be made of; the message says which.
    """
    return Run(settings, seed).finish()


class Run:
    """A run under way."""

    def __init__(self, settings: RunSettings, seed: int) -> None:
        self._began = time.perf_counter(), time.process_time()  # wall, CPU seconds
        _check(settings)
        self._settings = settings
        self._seed = seed
        self.queue = EventQueue()
        self._scenery = self._as_seeded(scenery_of(settings))
        self.log = EventLog(self.queue)
        self.fleet = fleet_of(
            settings.uavs,
            settings.ugvs,
            base=settings.base_station,
            original=settings.protocol == "original",
        )
        self.names = self.fleet.names  # by number; so are nodes, places and results
        self._numbers = {name: number for number, name in enumerate(self.names)}  # by name
        self.robots = self._ground_robots()
        self.uavs = self._uavs()
        self.ages = self._ages()
        self.nodes = [self._node(*each) for each in enumerate(self.names)]  # by number
        for uav in self.uavs:
            uav.node = self.nodes[self._numbers[uav.name]]
        self._places = np.zeros((len(self.names), 3))  # east, north, up in m, by number
        self._places[:, :2] = self.town.home
        self._places[:, 2] = GROUND_ANTENNA_M
        for uav in self.uavs:
            self._locate(uav)
        for name, robot in self.robots.items():
            self._places[self._numbers[name], :2] = robot.position
        self._starts = [robot.position for robot in self.robots.values()]
        self._travelled_m = np.zeros(len(self.names))  # over ground, by number
        channel = channel_of(settings, self.town, self.names, seed)
        self.airtime = AirtimeStats(self.log.sent)
        self.channel_sim = ChannelSim(self.queue, channel, self.nodes, self.airtime)
        self._samples: list[tuple[float, float, npt.NDArray[np.float32]]] = []  # as `_sample` takes
        self._goals: dict[str, GoalVisit] = {}  # first visits, by goal
        self._counted = dict.fromkeys(self.fleet.ugvs, 0)  # of its `visited`
        self._ground_at_s = 0.0  # simulated time of the ground robots' next step

    def finish(self) -> RunResult:
        """Let it run to its end."""
        settings, queue = self._settings, self.queue
        queue.every(settings.telemetry_s, self._tick)
        queue.every(settings.sample_s, self._sample)
        queue.run(settings.duration_s)
        wall_s, cpu_s = self._began
        times_s, shares = np.array([row[:2] for row in self._samples]).T
        places_m = [row[2] for row in self._samples]
        return RunResult(
            seed=self._seed,
            robots=self.names,
            kinds=self.fleet.kinds,
            travelled_m=tuple(self._travelled_m.tolist()),
            values=tuple(islice(cycle(settings.values or (1.0,)), settings.ugvs)),
            goals_total=len(self.town.goals),
            goal_bound_share=goal_bound_share(
                *(self.town, self._starts, settings.explorer, settings.duration_s)
            ),
            goal_places=tuple((goal.id, goal.position) for goal in self.town.goals),
            goals=tuple(sorted(self._goals.values(), key=lambda v: (v.time_s, v.goal))),
            transmissions=self.airtime.transmissions(),
            contacts=self.airtime.contacts(self.channel_sim.lasting()),
            exchanges_complete=self.airtime.complete,
            exchanges_broken=self.airtime.broken,
            exchanges_open=self.channel_sim.open,
            sample_times_s=times_s,
            positions_m=np.array(places_m, dtype=np.float32),
            held=self.ages.held(self.names, self.fleet.kinds),
            known_share=shares.astype(np.float32),
            states=tuple((uav.name, *state) for uav in self.uavs for state in uav.states),
            decisions=self.log.actions,
            digest=self.log.digest,
            wall_s=time.perf_counter() - wall_s,
            cpu_s=time.process_time() - cpu_s,
        )

    @property
    def town(self) -> Town:
        """Where it happens."""
        return self._scenery.town

    # Who takes part.

    def _as_seeded(self, scenery: Scenery) -> Scenery:
        """With the vehicles elsewhere, if the settings say so; no route depends on them."""
        if self._settings.goals == "town":
            return scenery
        town = scatter(scenery.town, self._seed, len(scenery.town.goals))
        return replace(scenery, town=town)

    def _ground_robots(self) -> dict[str, GroundRobot]:
        town = self.town
        count = len(self.fleet.ugvs)
        seeded = self._settings.starts == "seed"
        starts = drawn_starts(town, self._seed, count) if seeded else _starts(town, count)
        return {
            name: GroundRobot(
                name, town, _seed_of(self._seed, name), start, self._settings.explorer
            )
            for name, start in zip(self.fleet.ugvs, starts, strict=True)
        }

    def _uavs(self) -> list[Uav]:
        town, mission, plan = self.town, self._scenery.mission, self._scenery.plan
        controllers = controllers_of(self.fleet, self._scenery, self._settings)
        return [
            Uav(
                *(name, mission, plan, self._settings, self.queue, self.log, controller),
                MapPainter(town.frame.origin, town.raster, CAMERA),
            )
            for name, controller in controllers.items()
        ]

    def _ages(self) -> Ages:
        ages = Ages(self.queue)
        for uav in self.uavs:
            ages.watch(uav.name, MAP_TOPIC, partial(getattr, uav.painter, "known_cells"))
        for name, robot in self.robots.items():
            ages.watch(name, CLAIMS_TOPIC, robot.book.claims.copy)
        return ages

    def _node(self, number: int, name: str) -> Node:
        publish: Callable[[], list[tuple[str, bytes]]]
        hear: Callable[[LinkEvent], None]
        uav = next((each for each in self.uavs if each.name == name), None)
        if uav is not None:
            publish, hear = uav.say, self.ages.listener(name, uav.hear)
        elif name in self.robots:
            publish, hear = self.robots[name].outbox, self.ages.listener(name, self._ear(name))
        else:
            publish, hear = lambda: base_says(self.town, self.queue.now_s), _deaf
        triggered = self._settings.pulls == "node"
        return Node(
            *(number, name, self.fleet.team, self.queue),
            triggered=triggered,
            publish=publish,
            hear=hear,
        )

    def _ear(self, name: str) -> Callable[[LinkEvent], None]:
        """What a ground robot does with what happens on its links."""
        robot, number = self.robots[name], self._numbers[name]

        def hear(event: LinkEvent) -> None:
            if isinstance(event, MessageStored) and event.robot != name:
                data = self.nodes[number].data_of(event)
                robot.take(event.robot, event.topic, data, self.queue.now_s)

        return hear

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
                if self._settings.policy == "oracle" and now_s % ORACLE_S < GROUND_S:
                    for uav in self.uavs:
                        uav.see(name, robot.position)
        self._travelled_m += np.sqrt(((self._places[:, :2] - before) ** 2).sum(axis=1))
        self.ages.look()
        self.channel_sim.settle()
        self.channel_sim.look(self._places)

    def _locate(self, uav: Uav) -> None:
        self._places[self._numbers[uav.name]] = (
            *uav.flyer.position,
            max(uav.flyer.altitude_m, GROUND_ANTENNA_M),
        )

    def _count_goals(self, name: str, robot: GroundRobot) -> None:
        for visit in robot.visited[self._counted[name] :]:
            if visit.goal not in self._goals:
                self._goals[visit.goal] = GoalVisit(visit.goal, visit.time_s, name)
                self.log.goal(visit.goal, name)
        self._counted[name] = len(robot.visited)

    def _sample(self) -> None:
        known_share = self.uavs[0].painter.known_share if self.uavs else 0.0
        places_m = self._places[:, :2].astype(np.float32)
        self._samples.append((self.queue.now_s, known_share, places_m))


def _check(settings: RunSettings) -> None:
    if settings.uavs + settings.ugvs + settings.base_station == 0:
        raise ValueError("no robot takes part; say uavs, ugvs or base_station")
    if not 0 < settings.telemetry_s <= MOST_TELEMETRY_S:
        raise ValueError(
            f"telemetry_s of {settings.telemetry_s:g}; nothing is commanded from positions older "
            f"than {MOST_TELEMETRY_S:g} s"
        )


def _deaf(_event: LinkEvent) -> None:
    """Nothing that happens on its links matters to a base station."""


def _seed_of(seed: int, name: str) -> int:
    """A seed of its own for one robot."""
    return random.Random(f"{seed} {name}").getrandbits(62)  # noqa: S311 - repeatable on purpose


def _starts(town: Town, count: int) -> list[Point]:
    """Where robots start: at the town's places in their order, over again if there are too few."""
    if not town.starts:
        raise ValueError(f"{town.name} has no place where a ground robot could start")
    return [town.starts[number % len(town.starts)] for number in range(count)]


def channel_of(settings: RunSettings, town: Town, names: Sequence[str], seed: int) -> Channel:
    """The channel of a run."""
    if settings.channel == "paper":
        return PaperChannel(settings.paper, settings.radius_m, len(names), seed)
    return PathLossChannel(settings.path_loss, town, names, seed)
