"""Gathers the facts for the pre-flight card: about vehicle, this computer and the team."""

import asyncio
import shutil
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from air_router.mission import Mission
from air_router.preflight import preflight
from air_router.preflight.card import Card, Check
from air_router.preflight.preflight_parameters import names, parameters, straight_return
from air_router.routing import Router
from air_router.vehicle import Inspection, Telemetry, Vehicle, VehicleClock, VehicleInfo
from air_router.vehicle.px4 import version_of
from mocha_link import Team

DIAL_S: Final = 1.0
"""Wall-clock limit for a robot's node to answer."""

_GREETING: Final = b"\xff"
"""The first byte of every ZeroMQ connection."""


@dataclass(frozen=True, slots=True)
class PreflightSurvey:
    """The checks before a flight."""

    mission: Mission  # to be flown
    router: Router  # of the mission
    team: Team | None = None  # the team; None: not checked
    uav: str = ""  # our name in the team
    log_dir: Path | None = None  # where the log goes
    unix: Callable[[], float] = time.time  # this computer's clock
    clock: VehicleClock | None = None  # the vehicle's clock; None: runs like ours
    simulated: bool = False  # skips what a simulation lacks: sticks, wind, GPS time, radios

    async def card(self, vehicle: Vehicle, info: VehicleInfo, telemetry: Telemetry) -> Card:
        """Run all checks; nothing on board is changed.

        Nothing is requested from a vehicle that flies or is armed, because it has a pilot, nor from
        one that is no multicopter with PX4.
        """
        first = [preflight.vehicle(info), preflight.standing(telemetry)]
        if telemetry.in_air or telemetry.armed or info.airframe.why_not_flown is not None:
            return Card(tuple(first))
        team = asyncio.ensure_future(self._reachable())
        try:
            inspection = await vehicle.inspect(names(version_of(info.version)))
            reachable = await team
        finally:
            team.cancel()
        mission, planner = self.mission, self.mission.planner
        rate = await self._rate()
        checks: list[Check] = [
            *first,
            preflight.place(mission, self.router, info, telemetry),
            *preflight.altitude(mission, info, telemetry),
            preflight.health(inspection, simulated=self.simulated),
            preflight.gps(inspection.gps, planner.position_accuracy_m),
            *(() if self.simulated else (preflight.wind(inspection.wind_m_s, planner.wind_m_s),)),
            preflight.battery(mission, self.router, inspection.battery, inspection.voltage_v),
            *self._parameters(inspection, info, rate),
            straight_return(mission),
            *preflight.notes(mission),
        ]
        if not self.simulated:
            hours = any(zone.validity for zone in mission.zones)
            checks.append(preflight.clock(inspection, self.unix(), hours=hours))
        checks.append(preflight.disk(_free_bytes(self.log_dir)))
        if reachable is not None:
            checks.append(preflight.peers(reachable))
        return Card(tuple(checks))

    async def card_in_the_air(self, vehicle: Vehicle, info: VehicleInfo) -> Card:
        """Run the checks that matter in the air; nothing on board is changed."""
        inspection = await vehicle.inspect(names(version_of(info.version)))
        rate, mission = await self._rate(), self.mission
        return Card(
            (
                preflight.gps(inspection.gps, mission.planner.position_accuracy_m),
                preflight.battery(mission, self.router, inspection.battery, inspection.voltage_v),
                *self._parameters(inspection, info, rate),
                straight_return(mission),
                preflight.disk(_free_bytes(self.log_dir)),
            )
        )

    def _parameters(self, inspection: Inspection, info: VehicleInfo, rate: float) -> list[Check]:
        return parameters(
            self.mission,
            inspection.parameters,
            version=version_of(info.version),
            absent=inspection.absent,
            rate=rate,
        )

    async def _rate(self) -> float:
        return 1.0 if self.clock is None else await self.clock.measured_rate()

    async def _reachable(self) -> dict[str, bool] | None:
        """Which peers' nodes answer; None without a team, or if a simulation starts the nodes."""
        team = self.team
        if team is None or self.simulated:
            return None
        names = team.robot(self.uav).peers
        places = [(team.robot(n).address, team.robot(n).port_for(self.uav)) for n in names]
        answers = await asyncio.gather(*(_answers(*place) for place in places))
        return dict(zip(names, answers, strict=True))


async def _answers(host: str, port: int) -> bool:
    """Whether a node answers: its socket sends a greeting at once; a mere gateway does not."""
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(DIAL_S):
            family, kind, protocol, _, address = (
                await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            )[0]
            with socket.socket(family, kind, protocol) as probe:
                probe.setblocking(False)
                await loop.sock_connect(probe, address)
                return (await loop.sock_recv(probe, 1)) == _GREETING
    except (OSError, TimeoutError, ValueError):  # ValueError: an invalid host name
        return False


def _free_bytes(folder: Path | None) -> int | None:
    """Free disk space of a folder that need not exist yet."""
    if folder is None:
        return None
    folder = folder.absolute()
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free
