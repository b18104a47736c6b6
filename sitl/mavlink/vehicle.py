"""A vehicle as MAVLink sees it: autopilot and links together, without sockets or clocks."""

import math
import struct
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field
from typing import Final

from air_router.vehicle.px4 import Version
from sitl.mavlink.codec import Outgoing
from sitl.mavlink.link import MavlinkLink
from sitl.mavlink.reports import HealthReport, worded_as
from sitl.mavlink.telemetry import GROUND_RATES_HZ, ONBOARD_RATES_HZ, TRUTH_RATES_HZ
from sitl.px4sim import (
    BEHAVIOURS,
    DEFAULTS,
    USUAL,
    Autopilot,
    FlightMode,
    Notice,
    Parameters,
    StartPosition,
)
from sitl.px4sim.motion import WindSettings

STEP_S: Final = 0.02
_WALL_CLOCK: Final = ("COM_DL_LOSS_T", "COM_RC_LOSS_T", "COM_OF_LOSS_T", "COM_OBC_LOSS_T")
"""Time-outs whose wall-clock meaning PX4's start script keeps when the simulation runs fast."""

_ARGUMENTS: Final = 40


@dataclass(frozen=True, slots=True)
class VehicleSettings:
    """What a simulated vehicle is made with.

    Attributes:
        place: Where it starts.
        system_id: MAVLink system id; PX4's instance N has N + 1.
        seed: Of the estimate's errors.
        speed: Simulated seconds per wall-clock second.
        start_unix_s: Unix time of simulated time zero.
        parameters: Values that differ from PX4's defaults.
        wind: That blows.
        ground_link: Whether there is a link to a ground station; without one it costs nothing.
        truth_link: Whether there is a link that carries its true position.
        onboard_rates_hz: The streams of the onboard link.
        step_s: Simulated seconds of one step.
        version: Of PX4, that it behaves as.
    """

    place: StartPosition
    system_id: int = 1
    seed: int = 0
    speed: float = 1.0
    start_unix_s: float = 0.0
    parameters: Mapping[str, int | float] = field(default_factory=dict)
    wind: WindSettings = field(default_factory=WindSettings)
    ground_link: bool = True
    truth_link: bool = True
    onboard_rates_hz: Mapping[str, float] = field(default_factory=lambda: ONBOARD_RATES_HZ)
    step_s: float = STEP_S
    version: Version = USUAL


_GIMBAL_S: Final = 0.25
_REPEAT_S: Final = 0.5
_REPEATS: Final = 3
_CHANGE_SPEED: Final = 178  # MAV_CMD
_GIMBAL_CONTROL: Final = 1000
_GIMBAL_CONFIGURE: Final = 1001
_STOP_VIDEO: Final = 2003
_TAKE_GIMBAL: Final = (1.0, 1.0, -1.0, -1.0, 0.0, 0.0, 0.0)
_RELEASE_GIMBAL: Final = (-3.0, -3.0, -1.0, -1.0, 0.0, 0.0, 0.0)
_LOOK_AHEAD: Final = (*(math.nan,) * 4, 2.0, 0.0, 0.0)
_STOP: Final = (-1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
_CALM: Final = frozenset({FlightMode.AUTO_LAND, FlightMode.AUTO_RTL})

_Params = tuple[float, ...]


class OwnCommands:
    """The commands that PX4 itself sends to gimbals and cameras, whether there are any or not.

    Nobody acknowledges them, so PX4 repeats each three times. A companion has to ignore them.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._mode: FlightMode | None = None  # flown at the last step
        self._speed_m_s: float | None = None  # the mission's last DO_CHANGE_SPEED
        self._due: list[tuple[float, int, int, _Params]] = []  # when, MAV_CMD, confirmation

    def step(self) -> list[Outgoing]:
        """The COMMAND_LONGs that are due now; to be called after every step."""
        autopilot = self._autopilot
        now_s, mode = autopilot.time_s, autopilot.flying_mode
        if mode is not self._mode:
            if self._mode is FlightMode.AUTO_MISSION:
                self._plan(now_s, _STOP_VIDEO, _STOP)
            if self._mode is FlightMode.AUTO_MISSION or mode in _CALM:
                gimbal_s = now_s + _GIMBAL_S
                self._plan(gimbal_s, _GIMBAL_CONFIGURE, _TAKE_GIMBAL)
                self._plan(gimbal_s, _GIMBAL_CONTROL, _LOOK_AHEAD, repeats=0)
                self._plan(gimbal_s, _GIMBAL_CONFIGURE, _RELEASE_GIMBAL, repeats=0)
            self._mode = mode
        speed_m_s = autopilot.situation.speed_m_s if mode is FlightMode.AUTO_MISSION else None
        if speed_m_s != self._speed_m_s:
            self._speed_m_s = speed_m_s
            if speed_m_s is not None:
                self._plan(now_s, _CHANGE_SPEED, (1.0, speed_m_s, -1.0, 0.0, 0.0, 0.0, math.nan))
        due = [entry for entry in self._due if entry[0] <= now_s]
        self._due = [entry for entry in self._due if entry[0] > now_s]
        return [_command(number, attempt, params) for _, number, attempt, params in due]

    def _plan(self, at_s: float, number: int, params: _Params, repeats: int = _REPEATS) -> None:
        for attempt in range(repeats + 1):
            self._due.append((at_s + attempt * _REPEAT_S, number, attempt, params))


def _command(number: int, attempt: int, params: _Params) -> Outgoing:
    fields: dict[str, float] = {f"param{index}": value for index, value in enumerate(params, 1)}
    fields |= {"target_system": 1, "target_component": 0}
    return Outgoing("COMMAND_LONG", fields | {"command": number, "confirmation": attempt})


class MavlinkVehicle:
    """Autopilot with an onboard link, a ground station link and a truth link.

    Attributes:
        autopilot: The vehicle itself.
        onboard: What PX4 calls the API or offboard link.
        ground: The link to a ground station.
        truth: The simulator sends the vehicle's true position here; it receives nothing.
    """

    def __init__(self, settings: VehicleSettings) -> None:
        place, behaviour = _as_parameters(settings.place), BEHAVIOURS[settings.version]
        scaled = [name for name in _WALL_CLOCK if name not in behaviour.without]
        parameters = Parameters(
            {
                "MAV_SYS_ID": settings.system_id,
                "SIH_LOC_LAT0": place.latitude_deg,
                "SIH_LOC_LON0": place.longitude_deg,
                "SIH_LOC_H0": place.altitude_m,
            }
            | {name: DEFAULTS[name] * max(settings.speed, 1.0) for name in scaled}
            | dict(settings.parameters),
            behaviour,
        )
        scale, self._step_s = settings.speed, settings.step_s
        autopilot = self.autopilot = Autopilot(
            place,
            parameters,
            seed=settings.seed,
            time_scale=scale,
            wind=settings.wind,
        )
        autopilot.start_unix_s = settings.start_unix_s
        self._own_commands = OwnCommands(autopilot)
        self._health = HealthReport(autopilot)
        self.onboard = MavlinkLink(autopilot, settings.onboard_rates_hz, time_scale=scale)
        self.ground = MavlinkLink(autopilot, GROUND_RATES_HZ, time_scale=scale)
        # What comes in on one of these goes out on the other; a truth link only sends.
        self._links = (self.onboard, self.ground) if settings.ground_link else (self.onboard,)
        self._sends_truth = settings.truth_link  # else `truth` queues nothing
        self.truth = MavlinkLink(autopilot, TRUTH_RATES_HZ, reports_mission=False)

    def receive(self, link: MavlinkLink, datagram: bytes) -> None:
        """A datagram came in on one of the two links; frames for others go to the other link."""
        for frame in link.receive(datagram):
            for other in self._links:
                if other is not link:
                    other.pass_on(frame)
        self.autopilot.take_up_plan()

    def step(self) -> None:
        """Let one step of simulated time pass and queue the messages that are due."""
        self.autopilot.step(self._step_s)
        notices = self.autopilot.take_notices() + self._health.step()
        notices = [worded_as(notice, self.autopilot.behaviour) for notice in notices]
        events = [self._event(notice) for notice in notices if notice.event]
        events += self._own_commands.step()
        for link in self._links:
            link.step(notices, events)
        if self._sends_truth:
            self.truth.step([], [])

    def _event(self, notice: Notice) -> Outgoing:
        sequence = self.autopilot.events_sent
        self.autopilot.events_sent += 1
        return Outgoing(
            "EVENT",
            {
                "id": notice.event_id,
                "event_time_boot_ms": round(self.autopilot.time_s * 1e3),
                "sequence": sequence & 0xFFFF,
                "log_levels": notice.log_levels,
                "arguments": notice.arguments[:_ARGUMENTS],
            },
        )


def _as_parameters(place: StartPosition) -> StartPosition:
    """Where it really starts: PX4's simulator keeps the place in parameters of single precision."""
    return StartPosition(*struct.unpack("<fff", struct.pack("<fff", *astuple(place))))
