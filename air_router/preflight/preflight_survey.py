"""Gathers what the pre-flight card looks at: of the vehicle, of this computer, of the team."""

from __future__ import annotations

import asyncio
import shutil
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from air_router.mission.mission import Mission
from air_router.preflight import preflight
from air_router.preflight.energy import battery
from air_router.preflight.preflight import Card, Check
from air_router.preflight.preflight_parameters import NAMES, parameters, straight_return
from air_router.routing.router import Router
from air_router.vehicle.vehicle import Telemetry, Vehicle, VehicleInfo
from mocha_link import Team

DIAL_S: Final = 1.0
"""Wall-clock limit for a robot's node to answer."""

_GREETING: Final = b"\xff"
"""How every ZeroMQ connection begins."""


class PreflightSurvey:
    """What is looked at before a flight.

    Args:
        mission: To be flown.
        router: Of the mission.
        team: To talk to; None to leave it out.
        uav: Our name in the team.
        log_dir: Where the log goes.
        unix: This computer's clock.
        rate: Tells how many seconds of the vehicle pass in one of ours.
    """

    def __init__(  # noqa: PLR0913 - what there is to look at
        self,
        mission: Mission,
        router: Router,
        *,
        team: Team | None = None,
        uav: str = "",
        log_dir: Path | None = None,
        unix: Callable[[], float] = time.time,
        rate: Callable[[], float] = lambda: 1.0,
    ) -> None:
        self._mission = mission
        self._router = router
        self._team = team
        self._uav = uav
        self._log_dir = log_dir
        self._unix = unix
        self._rate = rate

    async def card(self, vehicle: Vehicle, info: VehicleInfo, telemetry: Telemetry) -> Card:
        """Look at everything; nothing on board is changed.

        A vehicle that flies or is armed has a pilot: it is asked nothing more.
        """
        first = [preflight.vehicle(info), preflight.standing(telemetry)]
        if telemetry.in_air or telemetry.armed:
            return Card(tuple(first))
        team = asyncio.ensure_future(self._reachable())
        try:
            inspection = await vehicle.inspect(NAMES)
            reachable = await team
        finally:
            team.cancel()
        mission = self._mission
        checks: list[Check] = [
            *first,
            preflight.place(mission, self._router, info, telemetry),
            *preflight.altitude(mission, info, telemetry),
            *preflight.health(inspection),
            preflight.gps(inspection.gps),
            preflight.wind(inspection.wind_m_s),
            battery(mission, self._router, inspection.battery, inspection.voltage_v),
            *parameters(mission, inspection.parameters, rate=self._rate()),
            straight_return(mission),
            *preflight.notes(mission),
            preflight.clock(
                inspection, self._unix(), hours=any(zone.validity for zone in mission.zones)
            ),
            preflight.disk(_free_bytes(self._log_dir)),
        ]
        if reachable is not None:
            checks.append(preflight.peers(reachable))
        return Card(tuple(checks))

    async def card_in_the_air(self, vehicle: Vehicle) -> Card:
        """Look at what still matters once it flies; nothing on board is changed."""
        inspection = await vehicle.inspect(NAMES)
        mission = self._mission
        return Card(
            (
                preflight.gps(inspection.gps),
                battery(mission, self._router, inspection.battery, inspection.voltage_v),
                *parameters(mission, inspection.parameters),
                straight_return(mission),
                preflight.disk(_free_bytes(self._log_dir)),
            )
        )

    async def _reachable(self) -> dict[str, bool] | None:
        """Whose node answers now; None without a team."""
        team = self._team
        if team is None:
            return None
        names = team.robot(self._uav).peers
        places = [(team.robot(n).address, team.robot(n).port_for(self._uav)) for n in names]
        answers = await asyncio.gather(*(_answers(*place) for place in places))
        return dict(zip(names, answers, strict=True))


async def _answers(host: str, port: int) -> bool:
    """Whether a node is there: its socket greets at once, a gateway that takes all does not."""
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
    except (OSError, TimeoutError):
        return False


def _free_bytes(folder: Path | None) -> int | None:
    """Room on the disk of a folder that need not exist yet."""
    if folder is None:
        return None
    folder = folder.absolute()
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free
