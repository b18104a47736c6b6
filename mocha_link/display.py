"""What the command prints for people: lines and tables."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mocha_link.team import Team


def team_tables(team: Team) -> str:
    """The robots and topics of a team with the ids and ports that follow from the file."""
    rows = [("robot", "id", "kind", "address", "ports", "radio")]
    for robot in sorted(team.robots.values(), key=lambda robot: robot.robot_id):
        ports = ", ".join(f"{peer}:{robot.port_for(peer)}" for peer in robot.peers)
        number = str(robot.robot_id)
        radio = robot.radio or f"timer, {team.trigger.interval_s:g} s"
        rows.append((robot.name, number, robot.kind, robot.address, ports, radio))
    robots = _table(rows)
    heads = ("kind", "topic", "id", "type", "dtype", "priority", "at most every")
    kinds: list[tuple[str, ...]] = [heads]
    for kind, topics in team.kinds.items():
        for topic in topics:
            interval = f"{topic.min_interval_s:g} s" if topic.min_interval_s else "-"
            ids = (str(topic.topic_id), topic.type, str(topic.dtype))
            kinds.append((kind, topic.name, *ids, topic.priority.name.lower(), interval))
    return f"{robots}\n\n{_table(kinds)}"


def event_line(fields: dict[str, Any]) -> str:
    """One event, given as `telemetry.as_fields` has it and `event`, its type."""
    rest = {key: value for key, value in fields.items() if key not in ("event", "peer", "at_s")}
    words = " ".join(f"{key}={_shown(value)}" for key, value in rest.items())
    at = datetime.fromtimestamp(fields["at_s"], UTC).isoformat(timespec="milliseconds")
    return f"{at[:-6]}Z {fields['event']} {fields['peer']} {words}"


def links_table(fields: dict[str, Any]) -> str:
    """A snapshot of all links, as `telemetry.snapshot` has it."""
    now = fields["at_s"]
    rows = [
        (
            "peer",
            "state",
            "signal",
            "in",
            "ago",
            "out",
            "ago",
            "RTT",
            "bandwidth",
            "newest",
            "broken",
        )
    ]
    for peer, link in fields["links"].items():
        rows.append(
            (
                peer,
                link["state"],
                signal_text(link),
                str(link["syncs_in"]),
                _ago(now, link["last_sync_in_s"]),
                str(link["syncs_out"]),
                _ago(now, link["last_sync_out_s"]),
                _with_unit(link["rtt_s"], "ms", 1000),
                _with_unit(link["bandwidth_bytes_s"], "kB/s", 0.001),
                _with_unit(link["newest_age_s"], "s"),
                str(link["timeouts"]),
            )
        )
    return f"links of {fields['robot']}\n{_table(rows)}"


def signal_text(link: Mapping[str, Any]) -> str:
    """How a peer is heard, with unit and source, from the fields of its metrics."""
    signal = link.get("signal")
    if signal is None:
        return _with_unit(link["rssi_dbm"], "dBm")
    unit = "dB SNR" if signal["unit"] == "dB" else str(signal["unit"])
    return f"{signal['value']:.0f} {unit} {signal['source']}"


def _ago(now_s: float, then_s: float | None) -> str:
    return _with_unit(None if then_s is None else now_s - then_s, "s")


def _with_unit(value: float | None, unit: str, factor: float = 1) -> str:
    return "-" if value is None else f"{value * factor:.1f} {unit}"


def _shown(value: object) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def _table(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join(lines)
