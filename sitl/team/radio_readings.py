"""Delivers radio readings to the robots' nodes, as their radios would: one datagram per reading."""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Iterable
from typing import Self
from urllib.parse import urlsplit

from mocha_link.team.team import Team
from sitl.world.world import Reading


class RadioReadings:
    """Sends readings to each robot's `radio` endpoint; robots without one get none."""

    def __init__(self, team: Team) -> None:
        self._endpoints = {
            robot.name: _endpoint(robot.radio)
            for robot in team.robots.values()
            if robot.radio is not None
        }
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def tell(self, readings: Iterable[Reading]) -> None:
        """Send readings; one that has no listener is lost, as on any radio."""
        for reading in readings:
            endpoint = self._endpoints.get(reading.robot)
            if endpoint is None:
                continue
            data = json.dumps({"peer": reading.peer, "rssi_dbm": reading.rssi_dbm}).encode()
            with contextlib.suppress(OSError):
                self._socket.sendto(data, endpoint)

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _endpoint(url: str) -> tuple[str, int]:
    parts = urlsplit(url)  # the team file has checked its form
    return parts.hostname or "", parts.port or 0
