"""The progress of a flight to be resumed, from its record or from the vehicle.

The record is replayed: the recorded controller knows the take-off time and the explored waypoints.
Without a record the vehicle knows its take-off time, but not the explored waypoints: its plan item
is only its last destination, perhaps to seek a robot or on the way home past unvisited items. So
all waypoints are flown again.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from air_router.controller import Controller
from air_router.controller.model import FlightSetup, FlownBefore
from air_router.errors import AirRouterError, PlanRefusedError, RefusedError
from air_router.flight.limits import RESUMED_CLOCKS_APART, RESUMED_CLOCKS_APART_S, RESUMED_RECORDS
from air_router.mission import FlightPlan, FlightWindow, Mission
from air_router.record import Log, replay_record
from air_router.vehicle import Telemetry, Vehicle, VehicleInfo

_log = logging.getLogger(__name__)


def as_begun(mission: Mission, folder: Path | None, now: datetime) -> tuple[Mission, str]:
    """The mission with the zones of a flight in progress, and the source as text.

    Zones with hours were selected when the flight began; a new selection would make the plan on
    board differ. The newest record of the mission has that time, unless such a flight must be over
    by now.

    Args:
        mission: The mission, as started now.
        folder: Folder of records; None: nothing is recorded.
        now: Current time by our clock.
    """
    if all(zone.validity is None for zone in mission.zones):
        return mission, ""
    for path in _newest(folder, None):
        try:
            setup = _setup(path)
        except (AirRouterError, OSError) as error:
            _log.info("%s: %s", path, error)
            continue
        if setup is None or _identity(setup.mission) != _identity(mission):
            continue
        window = _moved(mission.window, setup.mission.window)
        if window.end is not None and now > window.end:
            break
        mission = replace(mission, window=window)
        mission = mission.with_areas(mission.fences, mission.zones)
        return mission, f"no-fly zones with hours count from {window}, by the record {path}"
    return mission, "no-fly zones with hours count as for a flight that begins now"


def _moved(window: FlightWindow, began: FlightWindow) -> FlightWindow:
    """The window of a flight that began earlier, perhaps with a longer duration."""
    later = began.start - window.start
    end, latest = (None if t is None else t + later for t in (window.end, window.latest_start))
    if end is not None and (began.end is None or began.end > end):
        end = began.end
    return FlightWindow(began.start, end, latest)


async def recognised(
    vehicle: Vehicle, plan: FlightPlan, telemetry: Telemetry, *, resume: bool
) -> str:
    """Verify that a vehicle in the air flies this mission; return it as text.

    Raises:
        RefusedError: It does not, or it does but `--resume` is not given.
    """
    flies = f"the vehicle is flying ({telemetry.mode.value} mode)"
    try:
        await vehicle.recognise(plan)
    except PlanRefusedError as error:
        raise RefusedError(
            f"{flies}, and not with this mission on board ({error}); land it, then start the "
            "mission"
        ) from None
    found = f"{flies} with this mission on board"
    if not resume:
        raise RefusedError(f"{found}; land it, or give --resume to resume the flight")
    return found


class Resumption(NamedTuple):
    """The progress of the flight so far.

    Attributes:
        flown: Take-off time and explored waypoints.
        home_amsl_m: Home's altitude at the take-off, meters above mean sea level; None: unknown.
        words: Both, and their source, for the operator.
    """

    flown: FlownBefore
    home_amsl_m: float | None
    words: str


def flown_before(  # noqa: PLR0913 - all sources of the progress
    mission: Mission,
    info: VehicleInfo,
    telemetry: Telemetry,
    *,
    folder: Path | None = None,
    own: Path | None = None,
    rate: float = 1.0,
    unix: Callable[[], float] = time.time,
) -> Resumption:
    """Determine the progress of a flight, from its record or from the vehicle.

    Args:
        mission: The mission to resume.
        info: The vehicle, which may know its take-off time.
        telemetry: Telemetry of the vehicle in the air.
        folder: Folder of records, perhaps read-only; None: nothing is recorded.
        own: The record that this companion has just started there; None: none.
        rate: The vehicle's seconds per second of ours.
        unix: Our clock.
    """
    for path in _newest(folder, own):
        try:
            recorded = _recorded(path, mission, telemetry.time_s, rate, unix())
        except (AirRouterError, OSError) as error:
            _log.info("%s: %s", path, error)
            continue
        if recorded is not None and recorded[0].airborne_s >= (info.took_off_s or 0.0):
            words = _summary(mission, recorded[0], telemetry, f"by its record {path}")
            return Resumption(*recorded, words)
    flown = FlownBefore(info.took_off_s or 0.0)
    how = "by the vehicle's report"
    if info.took_off_s is None:
        how = "the take-off time is not known, so counted from when it was switched on"
    how += (
        "; without a record all waypoints are explored again, and heights count from the home that "
        "it has now"
    )
    return Resumption(flown, None, _summary(mission, flown, telemetry, how))


def _newest(folder: Path | None, own: Path | None) -> list[Path]:
    if folder is None:
        return []
    others = [path for path in folder.glob("*.mcap") if path != own and path.is_file()]
    return sorted(others, key=lambda path: path.stat().st_mtime, reverse=True)[:RESUMED_RECORDS]


def _recorded(
    path: Path, mission: Mission, now_s: float, rate: float, unix_s: float
) -> tuple[FlownBefore, float | None] | None:
    """The progress at a record's end, and home's altitude; None: another flight."""
    since_s = max(0.0, unix_s - path.stat().st_mtime) * rate
    setup = _setup(path)
    if setup is None or _identity(setup.mission) != _identity(mission):
        return None
    controller = Controller(setup)
    until_s = replay_record(Log(path), controller).until_s
    if abs(now_s - until_s - since_s) > RESUMED_CLOCKS_APART_S + RESUMED_CLOCKS_APART * since_s:
        return None  # the vehicle was switched off since
    flown, last = controller.flown, controller.telemetry
    if flown is None:
        return None
    amsl_m = None if last is None else last.altitude_amsl_m
    return flown, None if last is None or amsl_m is None else amsl_m - last.altitude_m


def _setup(path: Path) -> FlightSetup | None:
    """The setup of a recorded flight."""
    return next((entry.value for entry in Log(path) if entry.kind == "setup"), None)


def _identity(mission: Mission) -> tuple[object, ...]:
    """The identity of a mission, independent of zones drawn since."""
    return mission.home, mission.uav, mission.waypoints


def _summary(mission: Mission, flown: FlownBefore, telemetry: Telemetry, how: str) -> str:
    done, flown_s = flown.visited - len(flown.left_out), telemetry.time_s - flown.airborne_s
    return (
        f"in the air for {flown_s:.0f} s, {done} of {len(mission.waypoints)} waypoints "
        f"explored ({how})"
    )
