"""The world around the autopilot as a pure object: the vehicle moves, the world reacts.

`World.step` takes the time and where the vehicle truly is, and returns what a shell has to
carry out: links to cut or restore, radio readings to deliver, messages that robots publish, what
the camera sees. It knows no sockets, threads or clocks.
"""

import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from operator import itemgetter

import numpy as np

from geo.frame import LocalFrame, Point
from geo.grid import GridPatch
from sitl.world.air_to_ground import ROOF_M, Numbers
from sitl.world.explorers import GroundRobot, Visit, first_visits
from sitl.world.ground_robots import Every, ExplorerUgv, PatrolUgv, Publication, Ugv
from sitl.world.measured_link import air_loss
from sitl.world.radio import PairPowers
from sitl.world.towns import Raster
from sitl.world.ugv import Patrol, PatrolPlan, PatrolRobot
from sitl.world.world_file import WorldPlan

STEP_S = 0.1
"""The world acts at most this often, in simulated seconds."""

GROUND_ANTENNA_M = 0.5
_ABOVE_M = 15.0  # so near across, one vehicle counts as above the other
LANDED_BELOW_M = 1.5  # lower than this the vehicle's antenna is as low as a robot's


@dataclass(frozen=True, slots=True)
class Truth:
    """Where the vehicle truly is.

    Attributes:
        time_s: Simulated seconds.
        unix_s: The same moment as Unix time, with which messages are stamped.
        position: Metres east/north in the mission's local frame.
        height_m: Metres above the ground at home.
        heading_deg: Clockwise from true north.
    """

    time_s: float
    unix_s: float
    position: Point
    height_m: float
    heading_deg: float


@dataclass(frozen=True, slots=True)
class LinkChange:
    """The radio between two robots came up or went down."""

    a: str
    b: str
    up: bool


@dataclass(frozen=True, slots=True)
class Reading:
    """The reading of `robot`'s radio about a peer; None: no signal received."""

    robot: str
    peer: str
    rssi_dbm: float | None


@dataclass(frozen=True, slots=True)
class Step:
    """What happened in one step, for the shell to carry out.

    Attributes:
        links: Radios that came up or went down.
        readings: Of radios.
        publications: What robots publish.
        patches: What the cameras of vehicles see, by vehicle.
    """

    links: tuple[LinkChange, ...] = ()
    readings: tuple[Reading, ...] = ()
    publications: tuple[Publication, ...] = ()
    patches: Mapping[str, GridPatch] = field(default_factory=dict)


@dataclass(slots=True)
class Contact:
    """How often and how long two robots were in radio contact.

    Attributes:
        count: Contacts so far, the present one included.
        seconds: Simulated seconds in contact.
        last_s: Unix seconds of their last contact; None: never.
        closest_m: The smallest distance between them.
        up: They are in contact now.
    """

    count: int = 0
    seconds: float = 0.0
    last_s: float | None = None
    closest_m: float = math.inf
    up: bool = False


@dataclass(slots=True)
class Approach:
    """How near two vehicles came to each other while at least one of them flew.

    Attributes:
        closest_m: The smallest distance between them; infinite: they never flew.
        across_m: What of it lay across, then.
        up_m: What of it lay up and down, then.
        at_s: Simulated seconds, then.
        level_m: The smallest difference in height while they were `_ABOVE_M` or less apart across.
    """

    closest_m: float = math.inf
    across_m: float = math.inf
    up_m: float = math.inf
    at_s: float | None = None
    level_m: float = math.inf


class World:
    """Ground robots, radios and the camera, moved on by `step`.

    The robots set off, and fading begins, when a vehicle takes off for the first time: however
    long it takes to get ready, the same flight meets the same world.

    Args:
        plan: The world.
        frame: The mission's local frame.
        vehicles: Their names in the team; the time of the first is the world's.
        raster: What there is to see.
        topics: Topics that each robot may publish, by name; others it keeps to itself.

    Attributes:
        frame, vehicles, raster: As given.
        approaches: How near vehicles came to each other, by pair.
    """

    def __init__(
        self,
        plan: WorldPlan,
        frame: LocalFrame,
        vehicles: tuple[str, ...],
        raster: Raster,
        topics: Mapping[str, Collection[str]],
    ) -> None:
        self.frame, self.vehicles, self.raster = frame, vehicles, raster
        self._plan = plan
        robots = {} if plan.exploration is None else plan.exploration.robots()
        self._ugvs: dict[str, Ugv] = {n: ExplorerUgv(own, topics[n]) for n, own in robots.items()}
        for name, own in plan.patrols.items():
            patrol = PatrolRobot(name, own, plan.land_cover.vehicles)
            self._ugvs[name] = PatrolUgv(patrol, frame, topics[name])
        names = (*vehicles, *self.robots)
        self._pairs = {pair: Contact() for pair in itertools.combinations(names, 2)}
        self._ends = np.triu_indices(len(names), 1)  # of these pairs, by the places of names
        radio, seed = plan.radio, plan.seed
        self._powers = PairPowers(radio, names, seed)
        # Between vehicles above the roofs and robots below; None: as any other.
        self._air = radio.air and air_loss(radio.air, radio.carrier_ghz, seed)
        self.approaches = {pair: Approach() for pair in itertools.combinations(vehicles, 2)}
        self._reading = Every(plan.radio.reading_interval_s)
        self._picture = Every(plan.camera.interval_s)
        self._now_s: float | None = None  # of the last step
        self._took_off_s: float | None = None  # the first vehicle; from then on robots drive

    @property
    def robots(self) -> dict[str, PatrolRobot | GroundRobot]:
        """The ground robots, by name."""
        return {name: ugv.robot for name, ugv in self._ugvs.items()}

    @property
    def goals_total(self) -> int:
        """How many vehicles exploring robots search for."""
        return len(self._plan.exploration.town.goals) if self._plan.exploration else 0

    @property
    def goals(self) -> list[Visit]:
        """The goals that exploring robots have reached first, in order of Unix time."""
        return first_visits(r for r in self.robots.values() if isinstance(r, GroundRobot))

    @property
    def policy_faults(self) -> dict[str, str]:
        """What went wrong in policies of exploring robots, by robot."""
        explorers = [own for own in self.robots.values() if isinstance(own, GroundRobot)]
        return {own.name: fault for own in explorers if (fault := own.policy_fault) is not None}

    def stand(self, name: str, place: Point) -> None:
        """A robot is here from now on: its own program drives it and publishes its messages."""
        ugv = self._ugvs[name]
        if not isinstance(ugv, PatrolUgv):
            here = PatrolPlan(Patrol([place]))
            ugv = PatrolUgv(PatrolRobot(name, here, self._plan.land_cover.vehicles), self.frame, ())
            self._ugvs[name] = ugv
        ugv.robot.stand(place)

    def receive(self, name: str, robot: str, topic: str, data: bytes) -> None:
        """A message of a robot has reached the ground robot `name`.

        Raises:
            MessageError, GridError, FrameError: the message is not of its topic's type.
        """
        self._ugvs[name].receive(robot, topic, data)

    def contact(self, a: str, b: str) -> Contact:
        """The contact of two robots so far."""
        return self._pairs[(a, b) if (a, b) in self._pairs else (b, a)]

    def due(self, time_s: float) -> bool:
        """Whether enough simulated time has passed for another step."""
        return self._now_s is None or time_s >= self._now_s + STEP_S - 1e-9

    def step(self, vehicles: Mapping[str, Truth]) -> Step:
        """Move on to a later time, with the vehicles where they are then.

        Args:
            vehicles: Their true states; others than the first may be missing, and have no contact
                then.
        """
        truth = vehicles[self.vehicles[0]]
        dt_s = 0.0 if self._now_s is None else max(0.0, truth.time_s - self._now_s)
        self._now_s = truth.time_s
        if self._took_off_s is not None:
            for ugv in self._ugvs.values():
                ugv.drive(dt_s, truth.unix_s)
        elif any(there.height_m >= LANDED_BELOW_M for there in vehicles.values()):
            self._took_off_s = truth.time_s
        links, readings = self._radio_step(vehicles, truth, dt_s)
        self._measure(vehicles, truth.time_s)
        patches = self._pictures(vehicles) if self._picture.due(truth.time_s) else {}
        times = truth.time_s, truth.unix_s
        publications = [message for ugv in self._ugvs.values() for message in ugv.publish(*times)]
        return Step(links, readings, tuple(publications), patches)

    def _pictures(self, vehicles: Mapping[str, Truth]) -> dict[str, GridPatch]:
        pictures = {
            name: self._plan.camera.picture(
                self.raster, truth.position, truth.height_m, truth.heading_deg
            )
            for name, truth in vehicles.items()
        }
        return {name: patch for name, patch in pictures.items() if patch is not None}

    def _measure(self, vehicles: Mapping[str, Truth], time_s: float) -> None:
        for (a, b), approach in self.approaches.items():
            one, two = vehicles.get(a), vehicles.get(b)
            if one is None or two is None or max(one.height_m, two.height_m) < LANDED_BELOW_M:
                continue
            across_m = math.dist(one.position, two.position)
            up_m = abs(one.height_m - two.height_m)
            if across_m <= _ABOVE_M:
                approach.level_m = min(approach.level_m, up_m)
            if (apart_m := math.hypot(across_m, up_m)) < approach.closest_m:
                approach.closest_m, approach.across_m, approach.up_m = apart_m, across_m, up_m
                approach.at_s = time_s

    def _radio_step(
        self, vehicles: Mapping[str, Truth], truth: Truth, dt_s: float
    ) -> tuple[tuple[LinkChange, ...], tuple[Reading, ...]]:
        changes: list[LinkChange] = []
        readings: list[Reading] = []
        flown_s = 0.0 if self._took_off_s is None else truth.time_s - self._took_off_s
        reading_due = self._reading.due(truth.time_s)
        places, (one, other) = self._antennas(vehicles), self._ends
        apart_m = np.sqrt(((places[one] - places[other]) ** 2).sum(axis=1))
        powers_dbm = self._powers_dbm(places, apart_m, flown_s).tolist()
        for (a, b), away_m, rssi_dbm in zip(self._pairs, apart_m.tolist(), powers_dbm, strict=True):
            if math.isnan(away_m):
                continue
            contact = self._pairs[a, b]
            received = rssi_dbm >= self._plan.radio.sensitivity_dbm
            contact.closest_m = min(contact.closest_m, away_m)
            if contact.up:
                contact.seconds += dt_s
            if received:
                contact.last_s = truth.unix_s
            if received != contact.up:
                contact.up = received
                contact.count += received
                changes.append(LinkChange(a, b, received))
            if reading_due:
                value = round(rssi_dbm, 1) if received else None
                readings += (Reading(a, b, value), Reading(b, a, value))
        return tuple(changes), tuple(readings)

    def _antennas(self, vehicles: Mapping[str, Truth]) -> Numbers:
        """East, north and up of all antennas in metres; nan for vehicles whose state is missing."""
        high = {
            name: (*there.position, max(there.height_m, GROUND_ANTENNA_M))
            for name, there in vehicles.items()
        }
        low = [(*robot.position, GROUND_ANTENNA_M) for robot in self.robots.values()]
        return np.array([*(high.get(name, (math.nan,) * 3) for name in self.vehicles), *low])

    def _powers_dbm(self, places: Numbers, away_m: Numbers, flown_s: float) -> Numbers:
        """What both ends of each pair receive of each other."""
        (a, b), plan = self._ends, self._plan
        low, above = places[:, 2] < LANDED_BELOW_M, places[:, 2] >= ROOF_M
        rssi_dbm = self._powers.rssi_dbm(a, b, away_m, low[a] & low[b], flown_s)
        if self._air is not None:
            for pair in np.flatnonzero(above[a] != above[b]):
                below, high = sorted(places[[a[pair], b[pair]]], key=itemgetter(2))
                lost_db = self._air.loss_db(high[None], below[None])[0, 0]
                rssi_dbm[pair] = plan.radio.tx_power_dbm - lost_db
        return rssi_dbm
