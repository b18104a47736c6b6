"""The table that a person reads after the flight."""

from collections.abc import Mapping
from typing import Any, Final

COLUMNS: Final = (
    *("robot", "found when sought", "syncs in/out", "bytes in/out", "newest data"),
    "map at last meeting",
)

KEPT_SHARE: Final = 0.95
"""Share of the requested speed below which the report names the slow process."""


def table(report: dict[str, Any]) -> str:
    """A flight's report as lines of text."""
    rows = [[*COLUMNS]]
    for name, robot in report["robots"].items():
        rows.append(
            [
                name,
                str(robot["found"]),
                f"{robot['syncs_in']}/{robot['syncs_out']}",
                f"{size_words(robot['bytes_in'])}/{size_words(robot['bytes_out'])}",
                "none" if robot["newest_age_s"] is None else f"{robot['newest_age_s']:.0f} s old",
                "none" if robot["map_share"] is None else f"{robot['map_share']:.0%}",
            ]
        )
    widths = [max(len(row[i]) for row in rows) for i in range(len(COLUMNS))]
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
        + (f", {interactions['partial']} ended by their budget" if interactions["partial"] else "")
    )
    if report["closest_approach_m"] is not None:
        lines.append(
            f"closest approach: {report['closest_approach_m']:.1f} m to "
            f"{report['closest_approach_to']} (clearance {report['clearance_m']:.1f} m)"
        )
    return "\n".join(lines) + "\n" + goals_line(report) + pace_line(report)


def goals_line(report: Mapping[str, Any]) -> str:
    """The number of vehicles found by simulated robots, if they searched for any."""
    goals = report.get("world", {}).get("goals", {"total": 0})
    if not goals["total"]:
        return ""
    return f"vehicles found by robots that explore: {len(goals['found'])} of {goals['total']}\n"


def pace_line(report: Mapping[str, Any]) -> str:
    """The speed of a simulation, and the processes that it waited for."""
    pace = report.get("world", {}).get("pace", {})
    requested, kept = pace.get("requested"), pace.get("kept")
    if kept is None:
        return ""
    waited = {name: of["waited_s"] for name, of in pace.get("processes", {}).items()}
    text = f"simulated at {kept:.1f} times real time"
    if kept < KEPT_SHARE * requested:
        text += f" of the {requested:g} requested"
        if any(seconds >= 1 for seconds in waited.values()):
            who = ", ".join(f"{seconds:.0f} s for {name}" for name, seconds in waited.items())
            text += f"; the world waited {who}"
    lost = went_on_without(pace)
    return f"{text}; it {lost}\n" if lost else f"{text}\n"


def went_on_without(pace: Mapping[str, Any]) -> str:
    """The processes that a simulation's clock no longer waits for, and since when; empty: none."""
    lost = {name: of["lost_s"] for name, of in pace.get("processes", {}).items()}
    names = [f"{name} at {lost_s:.1f} s" for name, lost_s in lost.items() if lost_s is not None]
    return f"went on without {' and '.join(names)}" if names else ""


def several(report: dict[str, Any], codes: Mapping[str, int]) -> str:
    """The report of several flights as text: one part each, and their closest distances."""
    parts = []
    for uav, part in report["uavs"].items():
        text = table(part) if part else f"no report (exit code {codes[uav]}): see above\n"
        parts.append(f"\n{uav}\n{text}")
    lines = []
    for pair in report["world"].get("vehicles", ()):
        if pair["closest_m"] is not None:
            names = " and ".join(pair["pair"])
            lines.append(
                f"{names}: never nearer than {pair['closest_m']:.1f} m "
                f"({pair['across_m']:.1f} m across, {pair['up_m']:.1f} m in height), "
                f"{pair['contacts']} contacts, {pair['contact_s']:.0f} s\n"
            )
    apart = "\n" + "".join(lines) if lines else ""
    return "".join(parts) + apart + goals_line(report) + pace_line(report)


def size_words(count: float) -> str:
    """A number of bytes with at most four digits."""
    if count < 10_000:
        return f"{count:.0f} B"
    if count < 10_000_000:
        return f"{count / 1e3:.0f} kB"
    return f"{count / 1e6:.0f} MB"


def clock(seconds: float) -> str:
    """Minutes and seconds, with hours if needed."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
