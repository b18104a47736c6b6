"""The only file of the golden streams that knows what classes, fields and modules are called today.

A stream is plain data in words of its own. When a class or a field is renamed, its row here names
the new one beside the same word, and no stream is touched.
"""

import dataclasses
import json
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import yaml

from air_router.controller.controller import Controller
from air_router.controller.model import actions, events, requests
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.states import State
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.loading import load_mission
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router
from air_router.vehicle import vehicle
from air_router.vehicle.height_frame import HomeMove
from geo.airspace.zone import Band, Circle, Outline, Zone
from geo.frame import Point
from geo.validity import Period, Validity
from mocha_link.links import metrics
from mocha_link.links.reading import Reading, Unit
from mocha_link.store.wire import Header
from sitl.experiment.campaign.running import settings_of
from sitl.experiment.engine.engine import Run
from sitl.experiment.plan_file import load_experiment
from sitl.experiment.robots.controllers import controllers_of, scenery_of
from sitl.experiment.robots.node import fleet_of
from sitl.experiment.settings import RunSettings
from sitl.rehearsal.faults import Fault, Scene
from sitl.rehearsal.simulated_flight import SimulatedFlight
from tests.golden.plain import Tape, Tongue

DAY = datetime(2026, 6, 1, 12, tzinfo=UTC)
"""When missions are read that have zones of certain times."""

# What a kind of thing is called here, its class, and its fields: "word" where the class has a field
# of that name, else "word=field".

EVENTS = {
    "telemetry": (
        vehicle.Telemetry,
        """time_s position_m=position altitude_m velocity_m_s heading_deg armed in_air mode failsafe
        battery item fix target_m=target altitude_amsl_m gps_amsl_m home_moved wind_m_s terminated
        ages""",
    ),
    "item_reached": (vehicle.ItemReached, "time_s item"),
    "plan_replaced": (vehicle.PlanReplaced, "time_s only_fence"),
    "plan_compared": (vehicle.PlanCompared, "time_s difference"),
    "vehicle_silent": (vehicle.LinkSilent, "time_s silent_s"),
    "sync_started": (metrics.SyncStarted, "peer at_s direction"),
    "sync_ended": (
        metrics.SyncEnded,
        "peer at_s direction messages bytes duration_s complete",
    ),
    "sync_timed_out": (metrics.SyncTimedOut, "peer at_s direction reason"),
    "message_stored": (metrics.MessageStored, "peer at_s robot topic header size"),
    "rssi": (metrics.RssiChanged, "peer at_s rssi_dbm signal"),
    "contact_began": (metrics.ContactBegan, "peer at_s signal"),
    "contact_ended": (metrics.ContactEnded, "peer at_s duration_s reason"),
    "robot_pose": (events.RobotPose, "robot position_m=position stamp_s peer"),
    "robot_path": (events.RobotPath, "robot points_m=points stamp_s"),
    "robot_sought": (events.RobotSought, "by robot stamp_s"),
    "airspace": (events.AirspaceChanged, "fences zones"),
    "plan_uploaded": (events.PlanRenewed, "why_not"),
    "flown_before": (events.FlownBefore, "airborne_s visited skipped=left_out"),
    "command_confirmed": (events.CommandConfirmed, "motion=action"),
    "command_failed": (events.CommandFailed, "motion=action reason"),
    "ask_hold": (requests.HoldNow, "request_id by"),
    "ask_resume": (requests.GoOn, "request_id by upload"),
    "ask_seek": (requests.SeekNow, "request_id by robot"),
    "ask_explore": (requests.ExploreNow, "request_id by"),
    "ask_home": (requests.ComeHome, "request_id by"),
    "ask_land": (requests.LandNow, "request_id by"),
    "ask_goto": (requests.GoTo, "request_id by points_m=points hold_s waits"),
    "ask_altitude": (requests.ChangeAltitude, "request_id by altitude_m"),
    "ask_reload": (requests.Reload, "request_id by"),
}
MOTIONS = {
    "fly_to_node": (actions.FlyToNode, "node position_m=position"),
    "fly_to_point": (actions.FlyToPoint, "position_m=position altitude_m"),
    "hold": (actions.HoldHere, ""),
    "land": (actions.LandHere, ""),
}
DECISIONS = {  # of an announcement only that there is one: sentences may be written better
    **MOTIONS,
    "publish_map": (actions.PublishMap, ""),
    "seeking": (actions.Seeking, "robot"),
    "read_mission_again": (actions.ReadAgain, ""),
    "upload_plan": (actions.RenewPlan, ""),
    "replan_airspace": (actions.ReplanAirspace, ""),
    "announce": (actions.Announce, ""),
    "state": (actions.StateChanged, "from=source to=target robot"),
    "answer": (actions.CommandAck, "request_id accepted code points_m=points"),
    "waits": (actions.MissionWaits, "interlock since_s"),
    "finish": (actions.Finish, "landed_by_us taken_by"),
}
PARTS = {
    "ages": (
        vehicle.Ages,
        "position_s mode_s armed_s battery_s fix_s landed_s item_s target_s",
    ),
    "home_move": (HomeMove, "east_m north_m up_m"),
    "header": (Header, "robot_id topic_id seconds milliseconds"),
    "reading": (Reading, "value unit source"),
    "zone": (Zone, "name shape clearance_m band crosses_fence validity"),
    "validity": (Validity, "periods"),
    "period": (Period, "start end"),
    "outline": (Outline, "ring holes"),
    "circle": (Circle, "centre_m=centre radius_m"),
    "band": (Band, "lower_m upper_m"),
}
WORDS = {
    "number:inf": math.inf,
    "number:-inf": -math.inf,
    "direction:in": metrics.Direction.IN,
    "direction:out": metrics.Direction.OUT,
    "unit:dbm": Unit.DBM,
    "unit:snr_db": Unit.SNR_DB,
    "unit:device": Unit.DEVICE,
    "mode:mission": vehicle.FlightMode.MISSION,
    "mode:hold": vehicle.FlightMode.HOLD,
    "mode:takeoff": vehicle.FlightMode.TAKEOFF,
    "mode:return": vehicle.FlightMode.RETURN,
    "mode:land": vehicle.FlightMode.LAND,
    "mode:position": vehicle.FlightMode.POSITION,
    "mode:altitude": vehicle.FlightMode.ALTITUDE,
    "mode:other": vehicle.FlightMode.OTHER,
    "taken:pilot": actions.ControlHolder.PILOT,
    "taken:failsafe": actions.ControlHolder.FAILSAFE,
    "state:ready": State.READY,
    "state:init": State.INIT,
    "state:search": State.SEARCH,
    "state:comm": State.COMM,
    "state:expl": State.EXPL,
    "state:goto": State.GOTO,
    "state:hold": State.HOLD,
    "state:home": State.HOME,
    "state:land": State.LAND,
    "state:done": State.DONE,
    "state:passive": State.PASSIVE,
    **{f"refused:{code.value}": code for code in actions.Refusal},
}


_TONGUE = Tongue((EVENTS, DECISIONS, PARTS), WORDS, Point)
plain_of, object_of, kind_of = _TONGUE.plain_of, _TONGUE.object_of, _TONGUE.kind_of


# Controllers.


class PlainController:
    """A controller that takes events, and gives its decisions, as plain data.

    Motions are numbered: an event names one by its number, for several may be alike.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._motions: list[Any] = []

    def decide(self, now_s: float, event: Mapping[str, Any]) -> list[Any]:
        """What it decides when this happens; numbers to two digits, which are centimetres."""
        number = event.get("motion")
        if number is not None:
            event = {**event, "motion": None}
        happened = object_of(event)
        if number is not None:
            happened = dataclasses.replace(happened, action=self._motions[number])
        return self.decisions_of(self._controller.handle(happened, now_s))

    def decisions_of(self, decided: list[Any]) -> list[Any]:
        """Decisions as plain data."""
        self._motions += [each for each in decided if kind_of(each) in MOTIONS]
        return [plain_of(each, 2) for each in decided]

    def event_of(self, event: Any) -> dict[str, Any]:
        """An event as plain data."""
        number = None
        if kind_of(event) in {"command_confirmed", "command_failed"}:
            number = next(n for n, each in enumerate(self._motions) if each is event.action)
            event = dataclasses.replace(event, action=number)
        plain: dict[str, Any] = plain_of(event)
        return plain

    @property
    def reaction_s(self) -> float:
        """For how long the vehicle is thought to fly on before it follows a command."""
        return round(self._controller.gate.reaction_s, 3)

    @reaction_s.setter
    def reaction_s(self, seconds: float) -> None:
        self._controller.gate.reaction_s = seconds


def controller_of(setup: Mapping[str, Any]) -> PlainController:
    """A fresh controller for a stream."""
    if "run" in setup:
        folder = _folder(json.dumps(setup["files"]))
        return PlainController(_controller_of_run(setup["run"], setup["name"], folder))
    path = _folder(json.dumps(setup["files"])) / "mission.yaml"
    mission = load_mission(path, uav=setup["name"] or None, start=DAY, in_flight=True)
    flight = FlightSetup(
        mission,
        tuple(setup["seek"]),
        pilot_arms=setup["pilot_arms"],
        explore=setup["explore"],
        name=setup["name"],
    )
    router, plan = Router(WaypointGraph(mission)), FlightPlan.of(mission)
    return PlainController(Controller(flight, router, plan))


@cache
def _folder(files: str) -> Path:
    """A folder with these files in it, until the program ends; the same ones share one."""
    folder = tempfile.TemporaryDirectory(prefix="golden-")
    _FOLDERS.append(folder)
    for name, text in json.loads(files).items():
        Path(folder.name, name).write_text(text, encoding="utf-8")
    return Path(folder.name)


_FOLDERS: list[tempfile.TemporaryDirectory[str]] = []


def _settings_of(run_: Mapping[str, Any], folder: Path) -> RunSettings:
    path = folder / "experiment.yaml"
    document = {"name": "golden", "title": "golden", "settings": run_, "rows": [{"label": "only"}]}
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    experiment, _ = load_experiment(str(path))
    return settings_of(experiment.task(experiment.rows[0], 0))


def _controller_of_run(run_: Mapping[str, Any], name: str, folder: Path) -> Controller:
    settings = _settings_of(run_, folder)
    original = settings.protocol == "original"
    fleet = fleet_of(settings.uavs, settings.ugvs, base=settings.base_station, original=original)
    return controllers_of(fleet, settings, scenery_of(settings, 0))[name]


# Recording.


def fly(mission: Path, fault: str, seed: int) -> list[Tape]:
    """Rehearse a flight; one tape for every life of its companion."""
    scenario = SimulatedFlight(Scene(Fault[fault], seed), mission)
    with _tapped(lambda: {"files": _files(scenario.file.text)}) as tapes:
        scenario.fly()
    return tapes


def make_run(settings: Mapping[str, Any], files: Mapping[str, str], seed: int) -> list[Tape]:
    """Make one run of an experiment; one tape for every UAV."""
    folder = _folder(json.dumps(files))
    with _tapped(lambda: {"files": files, "run": settings}) as tapes:
        Run(_settings_of(settings, folder), seed).finish()
    return tapes


def _files(text: str) -> dict[str, str]:
    """A mission and the files that it names, to be put side by side."""
    mission = yaml.safe_load(text)
    paths = [Path(mission[key]) for key in ("team", "world") if key in mission]
    paths += map(Path, mission.get("no_fly_files", ()))
    for path in paths:
        text = text.replace(str(path), path.name)
    return {"mission.yaml": text, **{path.name: path.read_text("utf-8") for path in paths}}


@contextmanager
def _tapped(about: Callable[[], dict[str, Any]]) -> Iterator[list[Tape]]:
    """Listen to every controller that is made meanwhile."""
    tapes: list[Tape] = []
    taps: dict[int, tuple[PlainController, Tape]] = {}
    make, handle = Controller.__init__, Controller.handle

    def made(self: Controller, flight: FlightSetup, *parts: Any, **options: Any) -> None:
        make(self, flight, *parts, **options)
        setup = {
            **about(),
            "name": flight.name,
            "seek": list(flight.seek),
            "pilot_arms": flight.pilot_arms,
            "explore": flight.explore,
        }
        tape = Tape(setup, [])
        tapes.append(tape)
        taps[id(self)] = PlainController(self), tape

    def handled(self: Controller, event: Any, now_s: float) -> list[Any]:
        adapter, tape = taps[id(self)]
        plain, reaction_s = adapter.event_of(event), adapter.reaction_s
        decided = handle(self, event, now_s)
        tape.steps.append((round(now_s, 3), reaction_s, plain, adapter.decisions_of(decided)))
        return decided

    with patch.object(Controller, "__init__", made), patch.object(Controller, "handle", handled):
        yield tapes
