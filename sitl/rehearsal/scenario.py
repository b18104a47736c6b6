"""One rehearsed flight in simulated time: vehicle, robots, companion, pilot, and a fault."""

from __future__ import annotations

import functools
import math
import os
import tempfile
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from air_router.mission import Mission, sought, team_of
from geo.frame import Point
from sitl.mavlink import MavlinkVehicle, Sender, VehicleSettings
from sitl.px4sim import Autopilot, StartPosition
from sitl.px4sim.motion import WindSettings
from sitl.rehearsal.companion import EPOCH_S, START, Companion, World
from sitl.rehearsal.courses import Agenda
from sitl.rehearsal.fakes import Burst, Link, Robots, Stations, Way, anywhere
from sitl.rehearsal.faults import BY_HAND, OF_SECOND, WIDE, Fault, Scene, wind_of
from sitl.rehearsal.judge import (
    COMPANION,
    AnnouncedLine,
    Evidence,
    FlightRecord,
    SceneEventKind,
    WireMessage,
)
from sitl.rehearsal.mission_file import (
    ANOTHER,
    MissionFile,
    changed,
    hurried,
    with_another_uav,
    with_room,
)
from sitl.rehearsal.seen import LANDS, RATES_HZ, Ending, phases, true_degrees, true_state
from sitl.rehearsal.zone_terms import with_terms

STEP_S: Final = 0.04
"""Of the vehicle, and so often its true state is noted: 25 times a second."""

TICK_S: Final = 0.1
REACTION_S: Final = 0.004
"""Less than the least delay of the link: a companion whose machine takes no time, and which has
received a choice, sends nothing more."""

BOOT_S: Final = 5.0
SOCKET_S: Final = 0.63
"""What a socket keeps of the messages to a program that stands still: the oldest, of so many
seconds. By default these are the first 256 of 405 datagrams a second; the newest are dropped."""

READS_S: Final = 0.0003
"""What a program takes for each message that was kept; its timers are due meanwhile."""


class SceneOverError(BaseException):
    """There is nothing more to be seen."""


class PowerCutError(BaseException):
    """The companion computer is off from one moment to the next."""


def _nothing() -> None:
    """No message of the companion is waited for."""


class Scenario(World, ABC):
    """Flies one scene, in which the companion's loop runs.

    Args:
        scene: What goes wrong.
        path: The mission.
        keys: Of the mission file that it flies with, on top of those of the scene.
        wind: That blows; None: the scene's.

    Attributes:
        scene: The same.
        agenda: What is still to happen.
        vehicle: The vehicle.
        link: Between it and the companion.
        stations: Pilot and ground stations.
        robots: On the ground.
        file: The mission file, which is drawn into.
        mission: As it was at the start.
        seek: Who is sought.
        companion: That runs now; None: none.
        after_order: Called once a message of the companion has reached the vehicle.
    """

    def __init__(
        self,
        scene: Scene,
        path: Path,
        *,
        keys: Mapping[str, Any] = MappingProxyType({}),
        wind: WindSettings | None = None,
    ) -> None:
        super().__init__()
        self.scene = scene
        self._keys, self._wind = keys, wind_of(scene) if wind is None else wind
        self.agenda = Agenda(scene.schedule())
        self._path = path
        self._dated = scene.fault is Fault.DAILY_HOURS
        self._uav = ANOTHER if scene.fault in OF_SECOND else None
        self.companion: Companion | None = None
        self.after_order: Callable[[], object] = _nothing
        self._rng = scene.chance("stage")  # the generator's name: another would be other flights
        self._sender = Sender(1, COMPANION)
        self._step_at_s = self._tick_at_s = STEP_S  # when the vehicle, and the script, move on next
        self._stalled_until_s = self._deaf_from_s = math.inf  # of the companion; inf: it runs
        self._socket_s = SOCKET_S  # what the companion's socket keeps
        self._kept: deque[tuple[str, Mapping[str, Any]]] = deque()  # there, not read yet
        self._reads_s = math.inf  # the first of them is read then
        self._inbox: list[Callable[[], object]] = []  # for the companion's loop, as soon as it runs
        self._restarts = False  # a companion is to be started
        self._ending = Ending()
        self._off_m = 0.0  # error of the estimate as it was recorded last
        self._seen = FlightRecord()  # for the judge
        self._report: Mapping[str, Any] = {}
        self._logs: Path | None = None  # where the companion keeps its own
        self.file: MissionFile
        self.mission: Mission
        self.seek: tuple[str, ...]
        self.vehicle: MavlinkVehicle
        self.stations: Stations
        self.robots: Robots
        self.link = Link(scene.chance("link"))

    @abstractmethod
    def let_happen(self) -> bool:
        """Let happen what is due; whether more is to happen soon."""

    # The flight

    def fly(self) -> Evidence:
        """From power-on to the end."""
        with tempfile.TemporaryDirectory() as folder:
            self._set_up(Path(folder))
            text = self.file.text
            maps = {name: Path(name).read_text("utf-8") for name in self.file.map_files}
            exit_code, outcome = self._fly()
        return self._seen.evidence(
            scene=str(self.scene),
            faults=self.scene.judged,
            mission_path=self._path.absolute(),
            mission_text=text,
            exit_code=exit_code,
            outcome=outcome,
            report=self._report,
            uav=self.mission.uav,
            reaction_s=REACTION_S,
            epoch_s=EPOCH_S if self._dated else None,
            map_files=maps,
        )

    def _set_up(self, folder: Path) -> None:
        scene, kind = self.scene, self.scene.fault.value
        document = changed(hurried(self._path), {**kind.mission, **self._keys}, kind.waypoints)
        self._logs = folder / "records" if kind.records else None
        document = with_room(document) if scene.draws else document
        if scene.fault is Fault.LAYERS:
            document = with_another_uav(document, folder, scene.chance("layers"))
        elif kind.document is None:
            # A clearance that is as wide as may be at its usual speed.
            document = with_terms(document, wide=scene.fault in WIDE and not self._keys)
        else:
            document = with_terms(document) if kind.terms else document
            document = kind.document(document, folder, scene.chance("document"))
        path = folder / "mission.yaml"
        masts = kind.document is None
        start = START if self._dated else None
        self.file = MissionFile(path, document, uav=self._uav, start=start, masts=masts)
        mission = self.mission = self.file.mission
        team, uav = team_of(mission, None)
        self.seek = sought(team, uav, mission.seek, mission.goals_from)
        latitude_deg, longitude_deg = mission.frame.to_geodetic(mission.home)
        self.vehicle = MavlinkVehicle(
            VehicleSettings(
                StartPosition(latitude_deg, longitude_deg, mission.home_altitude_amsl_m or 0.0),
                seed=scene.seed,
                start_unix_s=EPOCH_S,
                parameters={"SIM_BAT_DRAIN": 1500.0, "SIM_BAT_MIN_PCT": 0.0, **kind.parameters},
                wind=self._wind,
                ground_link=False,  # it is received from, and sends nothing
                truth_link=False,
                step_s=STEP_S,
                onboard_rates_hz={**RATES_HZ, **kind.streams},
                version=scene.px4,
            )
        )
        self.stations = Stations(self.vehicle, self._record, self._answered)
        waypoints = [waypoint.position for waypoint in mission.waypoints]
        places = {name: anywhere(self._rng, waypoints) for name in self.seek}
        weak = scene.chance("links") if scene.fault is Fault.WEAK_LINKS else None
        self.robots = Robots(mission, places, lambda: EPOCH_S + self.now_s, self.happened, weak)
        link = self.link
        link.loss = scene.most("loss")
        if Fault.BURSTS in scene.faults:
            link.burst = Burst(self._rng.uniform(5, 20), self._rng.choice((0.5, 2.0, 5.0)), 1.0)

    def _fly(self) -> tuple[int | None, str]:
        exit_code: int | None = None
        outcome = "killed"
        try:
            self._wait(lambda: self.now_s >= BOOT_S)
            self.agenda.enter("ready", self.now_s)
            self._restarts = True
            resume = False
            while True:
                self._wait(lambda: self._restarts)
                self._restarts = False
                exit_code, outcome = self._live(resume=resume)
                resume = True
        except SceneOverError:
            if self.companion is not None:
                exit_code, outcome = self.companion.exit_code, self.companion.outcome
        return exit_code, outcome

    def _wait(self, condition: Callable[[], bool]) -> None:
        while not condition():
            self.advance(self.now_s + TICK_S)

    def _live(self, *, resume: bool) -> tuple[int | None, str]:
        """One life of a companion, from start to end or power cut."""
        self.happened(SceneEventKind.STARTED)
        arm = not (resume or self.scene.fault in BY_HAND)
        companion = self.companion = Companion(
            *(self.file.path, self, self.send, self._print),
            arm=arm,
            resume=resume,
            records=self._logs,
            uav=self._uav,
            start=START if self._dated else None,
            result_first=self.scene.result_first,
        )
        try:
            companion.run()
        except PowerCutError:
            self.companion = None
            return None, "killed"
        self.companion = None
        self.happened(SceneEventKind.ENDED)
        self._report = companion.report
        return companion.exit_code, companion.outcome

    # World

    def advance(self, until_s: float) -> list[Callable[[], object]]:
        """See `World`; the times are seconds since the vehicle started."""
        while True:
            stalled = self._stalls
            if not stalled and self._stalled_until_s < math.inf:
                self._goes_on()
            if self._inbox and not stalled:
                break
            next_s = min(self._step_at_s, self.link.next_s, self._reads_s)
            if stalled:
                next_s = min(next_s, self._stalled_until_s)
            if next_s > until_s and not stalled:
                self.now_s = max(self.now_s, until_s)  # it may have stood still for longer
                break
            self.now_s = max(self.now_s, next_s)
            if self._stalled_until_s <= self.now_s:
                continue
            if self._reads_s <= min(self._step_at_s, self.link.next_s):
                self._read()
            elif self.link.next_s <= self._step_at_s:
                self.link.deliver(self.now_s)
            else:
                self._step()
            self._collect()
        inbox, self._inbox = self._inbox, []
        return inbox

    @property
    def _stalls(self) -> bool:
        """Whether the companion stands still."""
        return self.now_s < self._stalled_until_s < math.inf

    def _goes_on(self) -> None:
        """The companion's program goes on, and reads what its socket has kept."""
        self._stalled_until_s = self._deaf_from_s = math.inf
        self._reads_s = self.now_s if self._kept else math.inf
        self.happened(SceneEventKind.CONTINUED)

    def _read(self) -> None:
        """One message that the socket has kept is read."""
        name, fields = self._kept.popleft()
        self._reads_s = self.now_s + READS_S if self._kept else math.inf
        self._hand_on(name, fields)

    def call(self, callback: Callable[[], object]) -> None:
        """The companion is to call this when it runs."""
        self._inbox.append(callback)

    def send(self, name: str, fields: Mapping[str, Any]) -> None:
        """The companion sends a message to the vehicle."""
        vehicle, sender = self.vehicle, self._sender

        def arrive(arrived: Mapping[str, Any]) -> None:
            vehicle.receive(vehicle.onboard, sender.pack_values(name, arrived))
            self.after_order()

        arrives = self.link.send(Way.UP, name, fields, self.now_s, arrive)
        self._record(sender, name, fields, delivered=arrives)

    def _step(self) -> None:
        self._step_at_s = round(self._step_at_s + STEP_S, 6)
        self.vehicle.step()
        self._seen.samples.append(true_state(self.autopilot, self.now_s))
        if self.now_s >= self._tick_at_s:
            self._tick_at_s = round(self._tick_at_s + TICK_S, 6)
            self._tick()

    def _collect(self) -> None:
        """The vehicle's messages go over the link."""
        for message in self.vehicle.onboard.take_queue():
            if isinstance(message, bytes):
                continue  # passed on from a station: nothing that a companion reads
            name, fields = message.name, message.fields
            arrive = functools.partial(self._arrived, name)
            arrives = self.link.send(Way.DOWN, name, fields, self.now_s, arrive)
            self._seen.messages.append(
                WireMessage(self.now_s, 1, 1, fields.get("target_system", 0), name, fields, arrives)
            )
        self.vehicle.ground.take_queue()

    def _arrived(self, name: str, fields: Mapping[str, Any]) -> None:
        if self.companion is None:
            return
        if self._stalls or self._kept:
            if self.now_s < self._deaf_from_s:
                self._kept.append((name, fields))
        else:
            self._hand_on(name, fields)

    def _hand_on(self, name: str, fields: Mapping[str, Any]) -> None:
        companion = self.companion
        if companion is not None:
            self._seen.received.append(WireMessage(self.now_s, 1, 1, 0, name, fields))
            self._inbox.append(functools.partial(companion.receive, name, fields))

    def receive_foreign(
        self, sender: tuple[int, int], name: str, fields: Mapping[str, Any]
    ) -> None:
        """Another component sends on the companion's link."""
        companion = self.companion
        if companion is not None and not self._stalls:
            self.call(lambda: companion.receive(name, fields, sender))

    def _answered(self, receiver: Sender, kind: int, plan_id: int) -> None:
        """PX4 acknowledges another station's list: a router passes that on to all."""
        if self.scene.routed:
            target = {
                "target_system": receiver.system_id,
                "target_component": receiver.component_id,
            }
            fields = {**target, "type": 0, "mission_type": kind, "opaque_id": plan_id}
            self.receive_foreign((1, 1), "MISSION_ACK", fields)

    def _tick(self) -> None:
        companion, autopilot = self.companion, self.autopilot
        for phase in phases(autopilot, companion):
            self.agenda.enter(phase, self.now_s)
        goes_on = self.let_happen()
        if companion is not None and not self._stalls:
            node, place = companion.node, self.place
            self.call(lambda: self.robots.step(node, place, self.now_s))
        self._check_the_estimate()
        if autopilot.armed and not self._ending.flown:
            self.link.late_s, self.link.old_s = map(self.scene.most, ("late_s", "old_s"))
        in_charge = None if companion is None else companion.in_charge
        armed = autopilot.armed
        done = not goes_on and (companion is None or autopilot.mode not in LANDS)
        if self._ending.has_come(self.now_s, in_charge, armed=armed, done=done):
            raise SceneOverError

    # What happens

    def happened(self, what: SceneEventKind, value: Any = None) -> None:
        """For the record."""
        self._seen.happened(self.now_s, what, value)

    def do_stall(self, seconds: float) -> None:
        """The companion's program stands still for so long."""
        if self.companion is not None:
            self._stalled_until_s = self.now_s + seconds
            self._deaf_from_s = self.now_s + self._socket_s
            self.happened(SceneEventKind.STOPPED)

    def do_socket(self, seconds: float) -> None:
        """The companion's socket keeps the messages of so many seconds."""
        self._socket_s = seconds

    def do_kill(self, _: None) -> None:
        """The companion's power is gone."""
        if self.companion is not None:
            self.happened(SceneEventKind.KILLED)
            self._inbox.clear()
            self._kept.clear()
            self._reads_s = math.inf
            raise PowerCutError

    def do_restart(self, _: None) -> None:
        """The companion's power is back, and the flight is to be resumed."""
        if self.companion is None and self.autopilot.armed:
            self._restarts = True
            ended_s = max((h.time_s for h in self._seen.events(SceneEventKind.KILLED)), default=0.0)
            ended_unix_s = time.time() - (self.now_s - ended_s)
            for path in self._logs.glob("*") if self._logs else ():
                os.utime(path, times=(ended_unix_s, ended_unix_s))

    # What is seen

    @property
    def autopilot(self) -> Autopilot:
        """The vehicle's."""
        return self.vehicle.autopilot

    @property
    def place(self) -> Point:
        """Where the vehicle really is, in the mission's frame."""
        return self.mission.frame.to_local(*true_degrees(self.autopilot))

    def _print(self, text: str) -> None:
        self._seen.lines.append(AnnouncedLine(self.now_s, text))

    def _record(
        self, sender: Sender, name: str, fields: Mapping[str, Any], *, delivered: bool = True
    ) -> None:
        target = int(fields.get("target_system", fields.get("target", 0)))
        self._seen.messages.append(
            WireMessage(
                self.now_s, sender.system_id, sender.component_id, target, name, fields, delivered
            )
        )

    def _check_the_estimate(self) -> None:
        errors = self.autopilot.errors
        off_m = math.hypot(errors.north_m, errors.east_m)
        if abs(off_m - self._off_m) > 1.0:
            self._off_m = off_m
            self.happened(SceneEventKind.ESTIMATE_OFF, off_m)
