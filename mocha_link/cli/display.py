"""What the command prints for people: lines and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any


def event_line(fields: dict[str, Any], *, date: bool = True) -> str:
    """One event, given as `telemetry.as_fields` has it and `event`, its type."""
    unsaid = {"event", "peer", "at_s"}
    if "signal" in fields:
        unsaid.add("rssi_dbm")  # the same
    if fields.get("complete") is True:
        unsaid.add("complete")
    words = [f"{key}={_shown(value)}" for key, value in fields.items() if key not in unsaid]
    at = datetime.fromtimestamp(fields["at_s"], UTC).isoformat(timespec="milliseconds")
    at = at[:-6] if date else at[11:-6]
    return " ".join([f"{at}Z", str(fields["event"]), str(fields["peer"]), *words])


class EventFilter:
    """Tells which events are worth a line for a person who watches a node.

    Left out is what only repeats: that a sync begins, that one found nothing new after another
    that came to its end, and that one breaks off for the same reason as the one before.
    """

    def __init__(self) -> None:
        self._outcomes: dict[tuple[str, str], str | None] = {}  # of the last sync, by link

    def is_new(self, fields: dict[str, Any]) -> bool:
        """Whether to show an event, given as for `event_line`."""
        kind = fields["event"]
        if kind == "SyncStarted":
            return False
        if kind not in ("SyncEnded", "SyncTimedOut"):
            return True
        link = (fields["peer"], fields["direction"])
        known, before = link in self._outcomes, self._outcomes.get(link)
        self._outcomes[link] = fields.get("reason")
        brought = bool(fields.get("messages")) or fields.get("complete") is False
        return brought or not known or before != fields.get("reason")


_LINK_HEADS = (
    *("peer", "state", "path", "signal", "syncs in", "ago", "syncs out", "ago"),
    *("RTT", "bandwidth", "newest", "broken", "refused"),
)


def links_table(fields: dict[str, Any]) -> str:
    """A snapshot of all links, as `telemetry.snapshot` has it."""
    now = fields["at_s"]
    rows: list[tuple[str, ...]] = [_LINK_HEADS]
    for peer, link in fields["links"].items():
        rows.append(
            (
                peer,
                link["state"],
                path_text(link),
                signal_text(link),
                str(link["syncs_in"]),
                _ago(now, link["last_sync_in_s"]),
                str(link["syncs_out"]),
                _ago(now, link["last_sync_out_s"]),
                _with_unit(link["rtt_s"], "ms", 1000),
                _rate(link["bandwidth_bytes_s"]),
                _with_unit(link["newest_age_s"], "s"),
                str(link["timeouts"]),
                str(link.get("refused", "-")),
            )
        )
    lines = [f"links of {fields['robot']}", table(rows)]
    if fields.get("storage_fault"):
        lines.append(f"NOT ON DISK: {fields['storage_fault']}")
    return "\n".join(lines)


def path_text(link: Mapping[str, Any]) -> str:
    """What the last exchange with a peer went over, and whether it is encrypted."""
    path = str(link.get("path") or "-")
    return f"{path} key" if link.get("protected") else path


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


def _rate(bytes_s: float | None) -> str:
    if bytes_s is None:
        return "-"
    unit, factor = ("MB/s", 1e-6) if bytes_s >= 1e6 else ("kB/s", 1e-3)
    return f"{bytes_s * factor:.1f} {unit}"


def _shown(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, dict):  # a reading of a radio
        return " ".join(
            f"{part:g}" if isinstance(part, float) else str(part) for part in value.values()
        )
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def table(rows: Sequence[Sequence[str]]) -> str:
    """Rows as lines of text, their columns one below the other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join(lines)
