"""A vehicle as MAVLink sees it: autopilot and links together, without sockets or clocks."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from sitl.mavlink.mavlink_link import MavlinkLink
from sitl.mavlink.reports import HealthReport
from sitl.mavlink.telemetry import GROUND_RATES_HZ, ONBOARD_RATES_HZ, TRUTH_RATES_HZ, Telemetry
from sitl.px4sim.autopilot import Autopilot
from sitl.px4sim.motion.wind import WindSettings
from sitl.px4sim.own_commands import OwnCommands
from sitl.px4sim.state.notice import Notice, Outgoing
from sitl.px4sim.state.parameters import DEFAULTS, Parameters
from sitl.px4sim.state.px4_modes import VERSIONS, px4_version
from sitl.px4sim.state.situation import Place

STEP_S: Final = 0.02
_WALL_CLOCK: Final = ("COM_DL_LOSS_T", "COM_RC_LOSS_T", "COM_OF_LOSS_T", "COM_OBC_LOSS_T")
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
        truth_link: Whether there is one that says where it really is.
        onboard_rates_hz: What is streamed on the onboard link.
        step_s: Simulated seconds of one step.
        px4_version: One of `px4_version.VERSIONS`: what it behaves as where they differ.
    """

    place: Place
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
    px4_version: str = VERSIONS[0]


class MavlinkVehicle:
    """Autopilot with an onboard link, a ground station link and a truth link.

    Attributes:
        autopilot: The vehicle itself.
        onboard: What PX4 calls the API or offboard link.
        ground: The link to a ground station.
        truth: Where the simulator says where the vehicle really is; nothing is received on it.
    """

    def __init__(self, settings: VehicleSettings) -> None:
        place = _as_parameters(settings.place)
        parameters = Parameters(
            {
                "MAV_SYS_ID": settings.system_id,
                "SIH_LOC_LAT0": place.latitude_deg,
                "SIH_LOC_LON0": place.longitude_deg,
                "SIH_LOC_H0": place.altitude_m,
            }
            | _scaled_timeouts(settings.speed)
            | dict(settings.parameters)
        )
        scale, self._step_s = settings.speed, settings.step_s
        version = px4_version(settings.px4_version)
        self.autopilot = Autopilot(
            place,
            parameters,
            seed=settings.seed,
            time_scale=scale,
            wind=settings.wind,
        )
        self._own_commands = OwnCommands(self.autopilot)
        self._health = HealthReport(self.autopilot)
        self._telemetry = Telemetry(self.autopilot, settings.start_unix_s, version)
        self.onboard = MavlinkLink(
            self.autopilot, self._telemetry, settings.onboard_rates_hz, time_scale=scale
        )
        self.ground = MavlinkLink(
            self.autopilot, self._telemetry, GROUND_RATES_HZ, time_scale=scale
        )
        # What comes in on one of these goes out on the other; a truth link only sends.
        self._links = (self.onboard, self.ground) if settings.ground_link else (self.onboard,)
        self._tells_truth = settings.truth_link  # else `truth` queues nothing
        self.truth = MavlinkLink(
            self.autopilot, self._telemetry, TRUTH_RATES_HZ, reports_mission=False
        )

    def receive(self, link: MavlinkLink, datagram: bytes) -> None:
        """A datagram came in on one of the two links; what is not for us goes to the other."""
        for frame in link.receive(datagram):
            for other in self._links:
                if other is not link:
                    other.pass_on(frame)
        self.autopilot.take_up_plan()

    def step(self) -> None:
        """Let one step of simulated time pass and queue what is to be sent."""
        self.autopilot.step(self._step_s)
        notices = self.autopilot.take_notices() + self._health.step()
        events = [self._event(notice) for notice in notices if notice.event]
        events += self._own_commands.step()
        for link in self._links:
            link.step(notices, events)
        if self._tells_truth:
            self.truth.step([], [])

    def _event(self, notice: Notice) -> Outgoing:
        status = self._telemetry.status
        sequence = status.events_sent
        status.events_sent += 1
        return Outgoing(
            "EVENT",
            {
                "id": notice.event_id,
                "event_time_boot_ms": status.boot_ms,
                "sequence": sequence & 0xFFFF,
                "log_levels": notice.log_levels,
                "arguments": notice.arguments[:_ARGUMENTS],
            },
        )


def _as_parameters(place: Place) -> Place:
    """Where it really starts: PX4's simulator keeps the place in parameters of single precision."""
    latitude_deg, longitude_deg, altitude_m = struct.unpack(
        "<fff", struct.pack("<fff", place.latitude_deg, place.longitude_deg, place.altitude_m)
    )
    return Place(latitude_deg, longitude_deg, altitude_m)


def _scaled_timeouts(speed: float) -> dict[str, int | float]:
    """PX4's start script keeps the wall-clock meaning of these when the simulation runs fast."""
    return {name: DEFAULTS[name] * max(speed, 1.0) for name in _WALL_CLOCK}
