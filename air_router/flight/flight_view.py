"""Data for programs that show a flight: team, links, changes of state, areas, map."""

from __future__ import annotations

import base64
import dataclasses
import math
import zlib
from collections.abc import Callable
from typing import Any

from air_router.control import View
from air_router.controller import FlightStatus
from air_router.flight.flight_stats import FlightStats
from air_router.flight.limits import DEGREE_DIGITS
from air_router.flight.mission_reloader import ReloadReport
from air_router.live import scenery
from air_router.mission import Mission
from air_router.routing import Router
from air_router.web import degrees
from geo.frame import LocalFrame, Point
from mocha_link.links import LinkMetrics


class FlightView:
    """Answers `view`; decides nothing. Large data are made once, and sent on request.

    Args:
        mission: The mission with its frame and the UAV's name.
        status: Gives the flight's status.
        router: Returns the router for the zones in force.
        stats: Has the changes of state, and the map that the vehicle paints.
    """

    def __init__(
        self,
        mission: Mission,
        status: Callable[[], FlightStatus],
        router: Callable[[], Router],
        stats: FlightStats,
    ) -> None:
        self._frame, self._name = mission.frame, mission.uav or ""  # of the view's positions
        self._status, self._router, self._stats = status, router, stats
        self._areas: dict[str, Any] = {}  # as sent
        self._revision = 0  # of `_areas`; 0: none were made yet
        self._map: str | None = None  # compressed, in base64
        self._map_cells = 0  # known in `_map`

    def fields_for(self, command: View) -> dict[str, Any]:
        """The requested data as JSON values."""
        status = self._status()
        about: dict[str, Any] = {
            "uav": self._name,
            "origin": list(self._frame.origin),
            "changes": self._changes(),
            "alarms": [
                {"about": about, "text": alarm.lasting, "instruction": alarm.instruction}
                for about, alarm in status.alarms.items()
            ],
            "robots": self._received(status),
            "links": [self._link(link) for _, link in sorted(status.links.items())],
            "areas_revision": status.airspace.revision,
            "known_cells": self._stats.mapper.known_cells,
        }
        if command.areas:
            if self._revision != status.airspace.revision:
                router = self._router()
                self._areas = scenery(router.graph.mission, router)
                self._revision = status.airspace.revision
            about["areas"] = self._areas
        if command.map:
            about["map"] = self._encoded_map()
        return about

    def _changes(self) -> list[dict[str, Any]]:
        """The latest changes of state, numbered from the start of the flight."""
        first = self._stats.changed - len(self._stats.changes) + 1
        return [
            {
                "number": number,
                "left": change.source.name,
                "signal": change.signal.name,
                "why": change.signal.value,
                "state": change.target.name,
            }
            for number, change in enumerate(self._stats.changes, first)
        ]

    def _received(self, status: FlightStatus) -> dict[str, list[float]]:
        """The last positions of robots that may be sought."""
        return {
            robot: degrees(self._frame, target.position)
            for robot, target in status.targets.items()
            if target.position is not None
        }

    @staticmethod
    def _link(link: LinkMetrics) -> dict[str, Any]:
        return {
            "peer": link.peer,
            "state": link.state.name,
            "signal": None if link.signal is None else link.signal.text,
            "rssi_dbm": link.rssi_dbm,
            "rtt_s": link.rtt_s,
            "bandwidth_bytes_s": link.bandwidth_bytes_s,
            "bytes_in": link.bytes_in,
            "bytes_out": link.bytes_out,
            "syncs_in": link.syncs_in,
            "syncs_out": link.syncs_out,
            "timeouts": link.timeouts,
            "newest_age_s": link.newest_age_s,
            "team_differs": link.team_differs,
        }

    def _encoded_map(self) -> str:
        if self._map is None or self._map_cells != self._stats.mapper.known_cells:
            self._map_cells = self._stats.mapper.known_cells
            packed = zlib.compress(self._stats.mapper.grid.encode(), level=1)
            self._map = base64.b64encode(packed).decode("ascii")
        return self._map


def waiting_of(status: FlightStatus) -> dict[str, Any] | None:
    """The interlock that blocks the mission, as plain data; None: none."""
    waiting = status.waiting
    if waiting is None:
        return None
    return {
        "interlock": waiting.interlock,
        "why": waiting.why,
        "for_s": round(status.waiting_s, 1),
    }


def situation(
    frame: LocalFrame, status: FlightStatus, reading: ReloadReport | None
) -> dict[str, Any]:
    """The current situation of the flight.

    `reading`: the outcome of the latest reading of the mission file.
    """
    telemetry, goal, left_s = status.telemetry, status.goal, status.left_s
    about: dict[str, Any] = {
        "state": status.state.name,
        "robot": status.robot,
        "robots": list(status.targets),
        "time_left_s": None if left_s is None else round(left_s, 1),
        "goal": None if goal is None else _pair(frame, goal.position),
        "points_left": status.points_left,
        "waypoints_left": status.waypoints_left,
        "walled_in": status.no_way_home,
        "waiting": waiting_of(status),
        "reload": None if reading is None else dataclasses.asdict(reading),
    }
    if telemetry is None:
        return {**about, "position": None}
    return {
        **about,
        "position": _pair(frame, telemetry.position),
        "altitude_m": round(telemetry.altitude_m, 2),
        "speed_m_s": round(math.hypot(*telemetry.velocity_m_s), 2),
        "heading_deg": telemetry.heading_deg,
        "wind_m_s": telemetry.wind_m_s,
        "home_moved_m": telemetry.home_moved,
        "battery": telemetry.battery,
        "mode": telemetry.mode.value,
        "armed": telemetry.armed,
        "in_air": telemetry.in_air,
        "in_charge": status.in_charge,
        "time_s": telemetry.time_s,
    }


def _pair(frame: LocalFrame, point: Point) -> list[float]:
    return [round(degrees, DEGREE_DIGITS) for degrees in frame.to_geodetic(point)]
