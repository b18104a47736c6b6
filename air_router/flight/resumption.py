"""What is known of a flight that another companion goes on with: by its record, or by the vehicle.

The record is replayed: the controller that flew knows since when it flew, and what it explored.
Without a record the vehicle knows since when it flies, and nothing of what was explored: its plan
item is where it was sent to last, perhaps to seek a robot or to come home past items that it never
flew. So none of the waypoints counts as explored then, and all are flown again.
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
    """A mission among the zones that count in a flight of it that is under way, and how so.

    Zones with hours were chosen as it began: chosen anew, the plan on board would be another. The
    newest record of the mission tells when that was, unless such a flight must be over by now.

    Args:
        mission: As it would begin now.
        folder: Where records are; None where nothing is recorded.
        now: By our clock.
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
    """The window of a flight that began earlier, and was perhaps to stay out for longer."""
    later = began.start - window.start
    end, latest = (None if t is None else t + later for t in (window.end, window.latest_start))
    if end is not None and (began.end is None or began.end > end):
        end = began.end
    return FlightWindow(began.start, end, latest)


async def recognised(
    vehicle: Vehicle, plan: FlightPlan, telemetry: Telemetry, *, resume: bool
) -> str:
    """That a vehicle in the air flies this mission, as text.

    Raises:
        RefusedError: it does not; or it does, and is not to be flown on.
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
        raise RefusedError(f"{found}; land it, or say --resume to go on with the flight")
    return found


class Resumption(NamedTuple):
    """What is known of the flight until now.

    Attributes:
        flown: Since when, and what is explored.
        home_amsl_m: How high home was at the take-off, metres above mean sea level; None: unknown.
        words: Both, for the operator, and how it is known.
    """

    flown: FlownBefore
    home_amsl_m: float | None
    words: str


def flown_before(  # noqa: PLR0913 - all that something is known by
    mission: Mission,
    info: VehicleInfo,
    telemetry: Telemetry,
    *,
    folder: Path | None = None,
    own: Path | None = None,
    rate: float = 1.0,
    unix: Callable[[], float] = time.time,
) -> Resumption:
    """Since when a vehicle flies this mission and what it has explored, and how that is known.

    Args:
        mission: To be resumed.
        info: The vehicle, which may know when it took off.
        telemetry: It flies.
        folder: Where records are, also if none can be added; None where nothing is recorded.
        own: The record of this companion, which has just begun there; None if there is none.
        rate: Seconds of the vehicle's clock in one of ours.
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
    how = "by what the vehicle says"
    if info.took_off_s is None:
        how = "since when is not known, so from when it was switched on"
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
    """What a record knew at its end, and how high home was; None if that was another flight."""
    since_s = max(0.0, unix_s - path.stat().st_mtime) * rate
    setup = _setup(path)
    if setup is None or _identity(setup.mission) != _identity(mission):
        return None
    controller = Controller(setup)
    until_s = replay_record(Log(path), controller).until_s
    if abs(now_s - until_s - since_s) > RESUMED_CLOCKS_APART_S + RESUMED_CLOCKS_APART * since_s:
        return None  # it was switched off since
    flown, last = controller.flown, controller.telemetry
    if flown is None:
        return None
    amsl_m = None if last is None else last.altitude_amsl_m
    return flown, None if last is None or amsl_m is None else amsl_m - last.altitude_m


def _setup(path: Path) -> FlightSetup | None:
    """What was flown, by a record."""
    return next((entry.value for entry in Log(path) if entry.kind == "setup"), None)


def _identity(mission: Mission) -> tuple[object, ...]:
    """What makes it the same mission, whatever zones were drawn since."""
    return mission.home, mission.uav, mission.waypoints


def _summary(mission: Mission, flown: FlownBefore, telemetry: Telemetry, how: str) -> str:
    done, flown_s = flown.visited - len(flown.left_out), telemetry.time_s - flown.airborne_s
    return (
        f"in the air for {flown_s:.0f} s, {done} of {len(mission.waypoints)} waypoints "
        f"explored ({how})"
    )
