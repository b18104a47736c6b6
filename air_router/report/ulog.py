"""PX4's own log of the same flight, laid over ours: where it says it was, its charge, its modes."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from air_router.errors import AirRouterError, ExitCode
from air_router.report.flight_summary import FlightSummary
from geo.frame import FrameError, LocalFrame
from mocha_link.errors import needs_extra

TRACK_S: Final = 0.5
TOPICS: Final = ("vehicle_global_position", "battery_status", "vehicle_status")
ARMED: Final = 2
"""`vehicle_status.arming_state` of PX4."""

_NEAR_M: Final = 20.0
_MODES: Final = {
    0: "Manual",
    1: "Altitude",
    2: "Position",
    3: "Mission",
    4: "Hold",
    5: "Return",
    10: "Acro",
    12: "Descend",
    13: "Termination",
    14: "Offboard",
    15: "Stabilized",
    17: "Takeoff",
    18: "Land",
    19: "Follow",
    20: "Precision Land",
    21: "Orbit",
}


class UlogError(AirRouterError):
    """A file that is no ULog, has nothing of the flight in it, or cannot be read here."""

    exit_code = ExitCode.INVALID_FILE


@dataclass(slots=True)
class UlogTrack:
    """What PX4 logged, on the clock of our record.

    Attributes:
        track: (t, east_m, north_m) by its own estimate.
        battery: (t, charge 0..1).
        modes: (t, name of the flight mode) at each change.
        aligned_by: What its clock was laid on ours with.
        off_m: Median distance of its track to ours at the same times; None if there are none.
        version: Of PX4, as it says; `armed_s`: when it armed first.
    """

    track: list[tuple[float, float, float]] = field(default_factory=list)
    battery: list[tuple[float, float]] = field(default_factory=list)
    modes: list[tuple[float, str]] = field(default_factory=list)
    aligned_by: str = "the clock since it booted"
    off_m: float | None = None
    version: str = ""
    armed_s: float | None = None

    def as_json(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "version": self.version,
            "aligned_by": self.aligned_by,
            "off_m": self.off_m,
            "modes": [{"t": round(t, 3), "mode": mode} for t, mode in self.modes],
            "battery": [[round(t, 3), charge] for t, charge in self.battery],
            "track": [[round(v, 3) for v in row] for row in self.track],
        }

    def shifted(self, by_s: float) -> UlogTrack:
        """The same, some seconds later."""
        return UlogTrack(
            [(t + by_s, east_m, north_m) for t, east_m, north_m in self.track],
            [(t + by_s, charge) for t, charge in self.battery],
            [(t + by_s, mode) for t, mode in self.modes],
            "the moment of arming",
            None,
            self.version,
        )


def read_ulog(path: Path, summary: FlightSummary) -> UlogTrack:
    """What a ULog says of a recorded flight.

    Raises:
        UlogError: see there.
    """
    assert summary.setup is not None  # noqa: S101 - a complete summary has one
    found = _read(path, summary.setup.mission.frame)
    if not found.track and not found.battery and not found.modes:
        raise UlogError(f"{path}: has none of {', '.join(TOPICS)}")
    found.off_m = _apart_m(found, summary)
    # PX4's log counts from boot as its MAVLink messages do; after a restart in between it does not.
    far = found.off_m is None or found.off_m > _NEAR_M
    if far and found.armed_s is not None and summary.track:
        moved = found.shifted(summary.track[0][0] - found.armed_s)
        moved.off_m = _apart_m(moved, summary)
        if moved.off_m is not None and (found.off_m is None or moved.off_m < found.off_m):
            found = moved
    if found.off_m is None:
        raise UlogError(f"{path}: is not of this flight: it has no time in common with it")
    return found


def _read(path: Path, frame: LocalFrame) -> UlogTrack:
    with needs_extra("PX4's log", "ulog", "air-router"):
        from pyulog import ULog  # noqa: PLC0415 - an extra
    try:
        with path.open("rb") as file:
            log = ULog(file, list(TOPICS))
        data = {topic.name: topic.data for topic in reversed(log.data_list)}
        return _taken(data, frame, str(log.msg_info_dict.get("ver_sw", ""))[:12])
    except OSError:
        raise
    except Exception as error:  # noqa: BLE001 - pyulog raises what its bytes lead to
        raise UlogError(f"{path}: not a ULog that can be read: {error}") from None


def _taken(data: dict[str, Any], frame: LocalFrame, version: str) -> UlogTrack:
    found = UlogTrack(version=version)
    position = data.get("vehicle_global_position", {"timestamp": []})
    last_s = -math.inf
    for i, stamp in enumerate(position["timestamp"]):
        t = stamp / 1e6
        if t - last_s >= TRACK_S:
            last_s = t
            try:
                place = frame.to_local(float(position["lat"][i]), float(position["lon"][i]))
            except FrameError:
                continue
            found.track.append((t, *place))
    battery = data.get("battery_status", {"timestamp": []})
    for stamp, charge in zip(battery["timestamp"], battery.get("remaining", []), strict=False):
        if math.isfinite(charge) and (not found.battery or found.battery[-1][1] != charge):
            found.battery.append((stamp / 1e6, float(charge)))
    status = data.get("vehicle_status", {"timestamp": []})
    for i, stamp in enumerate(status["timestamp"]):
        number = int(status["nav_state"][i])
        mode = _MODES.get(number, f"mode {number}")
        if not found.modes or found.modes[-1][1] != mode:
            found.modes.append((stamp / 1e6, mode))
        if found.armed_s is None and int(status["arming_state"][i]) == ARMED:
            found.armed_s = stamp / 1e6
    return found


def _apart_m(ulog: UlogTrack, summary: FlightSummary) -> float | None:
    """The median distance of the two tracks at the same times."""
    times = [t for t, *_ in ulog.track]
    apart_m = []
    for t, east_m, north_m, _ in summary.track:
        index = bisect_left(times, t)
        if index < len(times) and times[index] - t <= TRACK_S:
            apart_m.append(math.dist(ulog.track[index][1:], (east_m, north_m)))
    return round(sorted(apart_m)[len(apart_m) // 2], 2) if apart_m else None
