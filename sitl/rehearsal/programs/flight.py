"""Flights of the real programs: `air-router fly`, MAVSDK and UDP, against a vehicle process.

The vehicle is `sitl vehicle` or a real PX4. A relay in between spoils the link and writes down what
passes and where the vehicle is: evidence for the one judge. Pilots and stations are played here.
"""

import contextlib
import math
import re
import signal
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from air_router.sim import free_port
from sitl.mavlink import Sender
from sitl.px4sim import FlightMode, MissionType
from sitl.rehearsal import (
    Agenda,
    Fault,
    ImpersonatedState,
    MissionFile,
    ScheduledFault,
    carry_out,
    false_messages,
)
from sitl.rehearsal.fakes import Station, StreamFault, intrusion
from sitl.rehearsal.judge import Evidence, SceneEvent, SceneEventKind
from sitl.rehearsal.programs.processes import OURS, Companion, Programs, draw_zone, hurry
from sitl.rehearsal.programs.recording import Recording
from sitl.rehearsal.programs.relay import LossyRelay, Weather, wait_until
from sitl.rehearsal.programs.scenes import WireScene

SPEED: Final = 5.0
DURATION_S, MEETING_S = 45, 200
STARTS_S: Final = 60.0
FLIGHT_S: Final = 420.0
"""Simulated seconds; a flight without a fault takes a quarter of it."""

WALL_S: Final = 300.0
DISARMED_S: Final = 5.0
"""Wall clock, until a vehicle that has landed is seen disarmed here, too."""

LET_GO_S: Final = 40.0
"""So long a vehicle is watched after the companion has ended, simulated."""

_REACTS_S: Final = 0.15
_SHOWS_S: Final = 8.0
_BEAT_S: Final = 0.05
_MOVED: Final = 0.4
_MOVE_S: Final = 0.3
"""So long a hand takes to move them there: from PX4 1.18 on their speed counts."""

_RESTS_S: Final = 0.5
"""Sticks are at rest first: what moves is taken for the pilot's."""

_NEED: Final = frozenset({Fault.PILOT, Fault.TWO_STATIONS, Fault.DISARMED, Fault.KILLED_IN_AIR})
"""Scenes that are none where the vehicle refused what was tried."""
_OLD_S: Final = 2.0
_LEFT_S: Final = 12.0
"""A file that is not taken is left so long after it was to be read."""
_STATE: Final = re.compile(r"-> ([A-Z_]+)")


@dataclass(eq=False)
class RealFlight:
    """One flight of a scene.

    Attributes:
        scene: What goes wrong.
        path: Of the mission file.
        speed: Times real time.
        px4: Where a real PX4 is; None: `sitl vehicle`.
        companion: How the `air-router` begins that is judged; for one not ours nothing waits.
        keys: Of the mission file that it flies with.
    """

    scene: WireScene
    path: Path
    speed: float = SPEED
    px4: str | None = None
    companion: Sequence[str] = OURS
    keys: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._agenda = Agenda(self.scene.schedule())
        self._pending = bool(self._agenda.left)  # something is to happen, and nothing of it has
        self._awaited: tuple[SceneEvent, Callable[[], bool]] | None = None  # not shown yet
        self._sticks_moved_s: tuple[float, float] | None = None  # None: no sticks
        self._relay: LossyRelay  # from `fly` on, as the others that have no value here
        self._seen: Recording  # by the relay
        self._companion: Companion  # the last that was started
        self._station: Station  # the pilot's, too
        self._file: MissionFile  # that is flown, drawn into on the way
        self._arguments: list[str] = []  # of every companion
        self._programs: Programs  # all but the companion

    def fly(self) -> Evidence:
        """From starting the programs to the end."""
        with (
            tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name,
            contextlib.ExitStack() as stack,
        ):
            folder = Path(name)
            file = self._file = hurry(self.path, folder, self.scene, self.keys)
            port = free_port()
            programs = self._programs = Programs(self.scene, file.path, self.speed, self.px4)
            stack.callback(programs.end_vehicles)
            ports = programs.start_px4() if self.px4 is not None else (0, 0)
            relay = stack.enter_context(LossyRelay(port, self.scene.seed, ports, self.speed))
            self._relay = programs.relay = relay
            self._seen = relay.recording
            relay.hold, relay.weather = programs.hold, Weather(loss=self.scene.most("loss"))
            self._station = relay.station()
            self._arguments = [
                *(str(file.path), f"--connect=udpin://127.0.0.1:{port}", f"--log-dir={folder}"),
                f"--duration={MEETING_S if self.scene.meets else DURATION_S}",
            ]
            if file.mission.layers:
                self._arguments.append(f"--uav={file.mission.uav}")
            if self.companion == OURS and not self.scene.deafens:
                self._arguments.append(f"--pace-from={programs.pace_source},{self.speed:g}")
            if self.scene.meets:
                self._arguments.append(stack.enter_context(programs.team(folder)))
            return self._flown()

    def _flown(self) -> Evidence:
        text = self._file.text  # it may be changed in flight
        self._start("--arm", "--yes")
        if self.px4 is None:
            self._programs.start_vehicle()
        try:
            wait_until(lambda: self._seen.armed or self._companion.ended, STARTS_S)
            self._run(self._seen.time_s)
        finally:
            code = self._companion.process.poll()
            self._companion.close()
        seen = self._seen
        seen.lines += self._companion.lines
        taken = any(seen.events(SceneEventKind.PILOT, SceneEventKind.DISARMED))
        nothing = self._pending or (self.scene.fault in _NEED and not taken)  # has gone wrong
        return seen.evidence(
            scene=f"{self.scene}{' on PX4' if self.px4 else ' over MAVLink'}",
            faults=frozenset({"NONE"}) if nothing else self.scene.judged,
            mission_path=self._file.path,
            mission_text=text,
            exit_code=code,
            outcome=self._companion.outcome,
            uav=self._file.mission.uav,
            map_files={name: Path(name).read_text("utf-8") for name in self._file.map_files},
            reaction_s=1.0 + _REACTS_S * self.speed,
            speed=self.speed,
            knows_meetings=False,
            pace=self._relay.pace(),
        )

    def _run(self, began_s: float) -> None:
        """Let happen what is to happen when it is to happen, until the flight is over."""
        wall_s = time.monotonic() + WALL_S
        gone_s: float | None = None
        while time.monotonic() < wall_s and self._seen.time_s < began_s + FLIGHT_S:
            now_s = self._seen.time_s
            if self._seen.armed:
                self._agenda.enter("armed", now_s)
            for line in tuple(self._companion.lines):
                if state := _STATE.search(line.text):
                    self._agenda.enter(state.group(1), line.time_s)
            for each in self._agenda.take(now_s):
                self._pending = False
                carry_out(each, self)
            self._watch(now_s)
            waits = any(each.what == "restart" for each in self._agenda.left)
            if "-> DONE" in self._companion.last:
                wait_until(lambda: not self._seen.armed, DISARMED_S)  # it reports once a second
                self._watch(self._seen.time_s)  # that may be what was waited for
                self._programs.end_vehicles()  # the companion draws its track meanwhile
                wait_until(lambda: self._companion.ended, WALL_S)
                return
            if (self._companion.ended and not waits) or self._is_left_alone():
                if gone_s is None and self._companion.ended and not self._is_killed():
                    self._note(SceneEventKind.ENDED)
                gone_s = now_s if gone_s is None else gone_s
                down = not self._seen.armed and self._seen.above_m < 0.3
                if (down and now_s > gone_s + 3.0) or now_s > gone_s + LET_GO_S:
                    return
            time.sleep(0.01)

    def _is_killed(self) -> bool:
        """Whether the companion was killed and has not been started since."""
        lives = [*self._seen.events(SceneEventKind.KILLED, SceneEventKind.STARTED)]
        return bool(lives) and lives[-1].what is SceneEventKind.KILLED

    def _is_left_alone(self) -> bool:
        """Whether the pilot has it for good and the companion waits for its landing."""
        events = list(self._seen.events(SceneEventKind.PILOT, SceneEventKind.REQUEST))
        taken = bool(events) and events[-1].what is SceneEventKind.PILOT  # not given back since
        return not self._agenda.left and (taken or "-> PASSIVE" in self._companion.last)

    def _watch(self, now_s: float) -> None:
        """Note what was chosen when the vehicle shows it; it may have been refused."""
        if self._sticks_moved_s is not None:  # from then on they are sent: else they are lost
            from_s, until_s = self._sticks_moved_s
            moved = min((now_s - from_s) / _MOVE_S, 1.0) if from_s <= now_s < until_s else 0.0
            self._station.sticks(_MOVED * moved)
        if self._awaited is not None:
            happening, shows = self._awaited
            if shows():
                self._seen.happenings.append(happening)
            if shows() or now_s > happening.time_s + _SHOWS_S:
                self._awaited = None

    def _note(self, what: SceneEventKind, value: object = None) -> None:
        self._seen.happened(self._seen.time_s, what, value)

    def _await(self, what: SceneEventKind, value: object, shows: Callable[[], bool]) -> None:
        if not shows():  # what is there already was not chosen now
            self._awaited = SceneEvent(self._seen.time_s, what, value), shows

    def _await_mode(self, mode: FlightMode, how: str = "") -> None:
        wanted = mode.custom_mode
        self._await(SceneEventKind.PILOT, how or mode.name, lambda: self._seen.mode == wanted)

    def _later(self, seconds: float, what: str) -> None:
        self._agenda.add(self._seen.time_s + seconds, ScheduledFault(seconds, what))

    # What is done, by the names of `scenes`.

    def do_pilot(self, value: str) -> None:
        """The pilot chooses a mode; those of the sticks need a transmitter that sends."""
        mode = FlightMode[value]
        if mode.needs_pilot:
            self._sticks_moved_s = self._sticks_moved_s or (math.inf, math.inf)
            for _ in range(10):
                self._station.sticks()
                time.sleep(_BEAT_S)
        self._await_mode(mode)
        self._station.choose(mode)

    def do_second_station(self, value: str) -> None:
        """Another station chooses a mode."""
        self._await_mode(FlightMode[value])
        self._relay.station(254).choose(FlightMode[value])

    def do_sticks(self, value: float) -> None:
        """The pilot holds the sticks for some seconds."""
        from_s = self._seen.time_s + _RESTS_S
        self._sticks_moved_s = from_s, from_s + value
        self._await_mode(FlightMode.POSCTL, "sticks")

    def do_resume(self, _value: object) -> None:
        """The operator requests it to go on."""
        self._note(SceneEventKind.REQUEST, "resume")
        self._companion.signal(signal.SIGUSR2)

    def do_request(self, value: str) -> None:
        """The operator types a request."""
        self._note(SceneEventKind.REQUEST, value)
        self._companion.type(value)

    def do_silent(self, value: bool | None) -> None:
        """Nothing passes, until this is switched off."""
        if value:
            self._note(SceneEventKind.FAULT, "silence")
        self._relay.weather.silent = bool(value)

    def do_stream(self, value: tuple[tuple[str, ...], StreamFault, float]) -> None:
        """One stream, or all of them, are lost, frozen or late for so long."""
        names, kind, lasts_s = value
        self._relay.weather.late_s = _OLD_S / self.speed
        self._relay.weather.streams = dict.fromkeys(names or ("",), kind)
        self._note(SceneEventKind.FAULT, kind.value)
        self._later(lasts_s, "stream over")

    def do_stream_over(self, _value: None) -> None:
        """They come as they are sent."""
        self._relay.weather.streams = {}

    def do_fence(self, _value: None) -> None:
        """A station deletes the fence."""
        self._note(SceneEventKind.FENCE_CHANGED, "deleted")
        self._station.send("MISSION_CLEAR_ALL", mission_type=MissionType.FENCE)

    def do_plan(self, value: str) -> None:
        """A station uploads the plan again, or another one."""

        def stored() -> None:
            self._note(SceneEventKind.FENCE_CHANGED, f"{value} plan")
            if value == "other":
                self._note(SceneEventKind.PILOT, "plan")

        self._relay.upload(self._seen.plan(backwards=value == "other"), stored)

    def do_home(self, value: float) -> None:
        """A station moves home up or down."""
        first, amsl_m = self._seen.samples[0], (self._seen.ground_m or 0.0) + value
        place = (first.latitude_deg, first.longitude_deg, amsl_m)
        self._note(SceneEventKind.HOME_MOVED, place)
        self._station.move_home(*place)

    def do_speed(self, value: float) -> None:
        """A station changes the speed."""
        self._note(SceneEventKind.FAULT, "speed")
        self._station.change_speed(value)

    def do_disarm(self, value: bool) -> None:
        """The pilot disarms it, by force if it has to be."""
        self._await(SceneEventKind.DISARMED, "pilot", lambda: not self._seen.armed)
        self._station.disarm(forced=value)

    def do_battery(self, value: float) -> None:
        """It falls faster from now on: so many seconds from full to empty."""
        self._note(SceneEventKind.BATTERY, value)
        self._station.set_parameter("SIM_BAT_DRAIN", value)

    def do_stall(self, value: float) -> None:
        """The companion's process gets no time for so long."""
        self._note(SceneEventKind.STOPPED)
        self._companion.signal(signal.SIGSTOP)
        self._later(value, "go on")

    def do_go_on(self, _value: object) -> None:
        """It gets time again."""
        self._note(SceneEventKind.CONTINUED)
        self._companion.signal(signal.SIGCONT)

    def do_kill(self, _value: object) -> None:
        """As a power failure does."""
        self._note(SceneEventKind.KILLED)
        self._companion.close()

    def do_restart(self, _value: object) -> None:
        """With --resume."""
        self._seen.lines += self._companion.lines
        self._start("--resume")

    def do_reboot(self, _value: object) -> None:
        """The autopilot's power fails, and it starts anew."""
        self._note(SceneEventKind.REBOOTED)
        self._programs.end_vehicles()
        self._seen.restart()
        self._programs.start_again()

    def do_move_link(self, _value: object) -> None:
        """The vehicle's messages come from another port."""
        self._note(SceneEventKind.FAULT, "link moved")
        self._relay.move()

    def do_reload(self, _value: object) -> None:
        """The operator draws a zone around a waypoint, and has the mission file read again."""
        draw_zone(self._file, self.scene.chance("zone"))
        self._note(SceneEventKind.MISSION_FILE, self._file.text)
        self.do_request("reload")

    def do_draw(self, _value: object) -> None:
        """The operator draws a zone while no companion is there to read it."""
        draw_zone(self._file, self.scene.chance("zone"))
        self._note(SceneEventKind.MISSION_FILE, self._file.text)

    def do_change(self, value: str) -> None:
        """The operator changes a number of the file and draws a zone, and has it read again."""
        self._file.rewrite(lambda document: document.update({value: document[value] * 2}))
        draw_zone(self._file, self.scene.chance("zone"))
        requested_s, text = self._seen.time_s, self._file.text
        self.do_request("reload")
        left = ScheduledFault(_LEFT_S, "left", (requested_s, text, value))
        self._agenda.add(requested_s + _LEFT_S, left)

    def do_left(self, value: tuple[float, str, str]) -> None:
        """What was not taken of the file is taken out of it."""
        requested_s, text, key = value
        self._note(SceneEventKind.FILE_LEFT, (requested_s, text))
        self._file.undo()
        self._file.rewrite(lambda document: document.update({key: document[key] / 2}))

    def do_claim(self, value: tuple[str, tuple[int, int]]) -> None:
        """Another system or component sends on the vehicle's link as its autopilot."""
        claim, sender = value
        seen = self._seen.samples[-1]
        state = ImpersonatedState(
            latitude_e7=round(seen.latitude_deg * 1e7),
            longitude_e7=round(seen.longitude_deg * 1e7),
            amsl_mm=round(seen.altitude_amsl_m * 1e3),
            boot_ms=round(self._seen.clock_s * 1e3),
            mode=self._seen.mode,
        )
        self._relay.claim(Sender(*sender).pack_values(*false_messages(state)[claim]))

    def do_second_vehicle(self, _value: object) -> None:
        """Another vehicle's messages come over the same radio."""
        self._programs.start_second_vehicle()

    def do_intrude(self, value: str) -> None:
        """An intruder sends something to the companion."""
        for data in intrusion(value, self.scene.chance("intruder")):
            self._relay.intrude(data)

    def _start(self, *how: str) -> None:
        self._note(SceneEventKind.STARTED)
        arguments, folder = [*self._arguments, *how], self._file.path.parent
        self._companion = Companion(self.companion, arguments, folder, lambda: self._seen.time_s)
