"""What a person reads when the flight is over: a table, and a picture of the track."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from pathlib import Path

    from air_router.flight import FlightResult
    from air_router.mission import Mission

_COLUMNS = (
    ("robot", "{}"),
    ("found", "{}"),
    ("syncs in/out", "{}"),
    ("bytes in/out", "{}"),
    ("newest data", "{}"),
    ("its share of the map", "{}"),
)


def write_report(
    mission: Mission, result: FlightResult, picture: Path | None, out: TextIO | None = None
) -> None:
    """Print the table on stderr, and draw the track into `picture` if one is wanted."""
    out = out if out is not None else sys.stderr
    out.write(table(result.report))
    if picture is None or not result.track:
        return
    from air_router.picture import PictureError, draw_mission  # noqa: PLC0415 - an extra

    try:
        draw_mission(mission, picture, track=result.track)
    except PictureError as error:
        out.write(f"no picture of the track: {error}\n")
    else:
        out.write(f"the track over the mission: {picture}\n")


def table(report: dict[str, Any]) -> str:
    """A flight's report as lines of text."""
    rows = [[name for name, _ in _COLUMNS]]
    for name, robot in report["robots"].items():
        rows.append(
            [
                name,
                str(robot["found"]),
                f"{robot['syncs_in']}/{robot['syncs_out']}",
                f"{_bytes(robot['bytes_in'])}/{_bytes(robot['bytes_out'])}",
                "none" if robot["newest_age_s"] is None else f"{robot['newest_age_s']:.0f} s old",
                "none" if robot["map_share"] is None else f"{robot['map_share']:.0%}",
            ]
        )
    widths = [max(len(row[i]) for row in rows) for i in range(len(_COLUMNS))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) for row in rows]
    lines.insert(1, "  ".join("-" * w for w in widths))
    interactions = report["interactions"]
    why = report.get("came_home_because")
    lines.append("")
    lines.append(
        f"{report['outcome']}: {report['duration_s']:.0f} s, {report['distance_m']:.0f} m flown, "
        f"states {', '.join(report['states_visited'])}"
    )
    if why is not None:
        lines.append(f"came home: {why}")
    lines.append(
        f"interactions: {interactions['started']} started, {interactions['completed']} completed, "
        f"{interactions['timed_out']} timed out"
    )
    if report["closest_approach_m"] is not None:
        lines.append(
            f"closest approach: {report['closest_approach_m']:.1f} m to "
            f"{report['closest_approach_to']} (clearance {report['clearance_m']:.1f} m)"
        )
    return "\n".join(lines) + "\n"


def _bytes(count: int) -> str:
    if count < 10_000:
        return f"{count} B"
    if count < 10_000_000:
        return f"{count / 1e3:.0f} kB"
    return f"{count / 1e6:.0f} MB"
