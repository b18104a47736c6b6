"""A flight as one HTML page that needs nothing else: no network, no script."""

import contextlib
import time
from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources
from typing import Any

from air_router.report.flight.charts import Figure, figures, legend_html, robot_css
from air_router.report.flight.flight_summary import FlightSummary
from air_router.report.flight.svg import clock
from air_router.report.flight.track import track_figure
from air_router.report.flight.ulog import UlogTrack
from air_router.report.palette import style_sheet
from air_router.report.report import size_words


def page_of(summary: FlightSummary, source: str, ulog: UlogTrack | None = None) -> str:
    """The page; `source` is the name of the record."""
    facts = summary.as_json()
    title = f"{facts['mission']}: flight of {facts['uav'] or 'the UAV'}"
    track = track_figure(summary, ulog)
    shown = [track] if track is not None else []
    shown += figures(summary, ulog)
    sheet = resources.files("air_router.report.flight").joinpath("page.css").read_text("utf-8")
    style = style_sheet() + sheet
    body = [
        _head(facts, title),
        _tiles(facts),
        *map(_section, shown),
        _robots(summary, facts),
        _table("Requests", ("at", "what", "who", "answer"), _requests(summary)),
        _table("Announcements", ("at", "text"), _said(summary)),
        _table("Commands not followed", ("at", "what"), _failures(summary)),
        _table("Flight modes in PX4's log", ("at", "mode"), _modes(summary, ulog)),
        _foot(facts, source, ulog),
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{escape(title)}</title><style>{style}</style></head>"
        f"<body><main>{''.join(body)}</main></body></html>\n"
    )


def _head(facts: dict[str, Any], title: str) -> str:
    words = []
    if facts["began_unix_s"] is not None:
        with contextlib.suppress(OverflowError, OSError, ValueError):  # a time that is none
            began = time.gmtime(facts["began_unix_s"])
            words.append(time.strftime("%Y-%m-%d %H:%M UTC", began))
    vehicle = facts["vehicle"]
    if vehicle:
        words.append(f"{vehicle.get('autopilot')} {vehicle.get('version')}")
    ending = ""
    if facts["ending"] is not None:
        ending = f'<p class="warning">The record is incomplete: {escape(facts["ending"])}.</p>'
    return f"<header><h1>{escape(title)}</h1><p>{escape(' · '.join(words))}</p>{ending}</header>"


def _tiles(facts: dict[str, Any]) -> str:
    share = facts["interactions"]["share_completed"]
    closest = facts["closest_approach_m"]
    charges = [charge for _, charge in facts["battery"]]
    why = facts["flight_report"].get("came_home_because")
    got, given = facts["interactions"]["bytes_in"], facts["interactions"]["bytes_out"]
    tiles = [
        ("outcome", str(facts["outcome"]), str(why or "")),
        ("flown", clock(facts["duration_s"]), f"{facts['distance_m']:.0f} m"),
        (
            "closest approach",
            "none" if closest is None else f"{closest:.1f} m",
            "no zones, no fence"
            if closest is None
            else f"to {facts['closest_approach_to']}; demanded {facts['clearance_m']:g} m",
        ),
        (
            "syncs completed",
            "none" if share is None else f"{100 * share:.1f} %",
            f"{facts['interactions']['completed']} of {facts['interactions']['started']} begun",
        ),
        (
            "exchanged",
            size_words(got + given),
            f"{size_words(got)} in, {size_words(given)} out",
        ),
    ]
    if charges:
        used = f"from {charges[0]:.0%} to {charges[-1]:.0%}"
        tiles.append(("battery used", f"{charges[0] - charges[-1]:.0%}", used))
    low = closest is not None and closest < facts["clearance_m"]
    items = "".join(
        f'<li class="{"bad" if low and name == "closest approach" else ""}"><span>{name}</span>'
        f"<b>{escape(value)}</b><small>{escape(more)}</small></li>"
        for name, value, more in tiles
    )
    return f'<ul class="tiles">{items}</ul>'


def _section(figure: Figure) -> str:
    words = f"<p>{escape(figure.words)}</p>" if figure.words else ""
    return (
        f'<section id="{figure.name}"><h2>{escape(figure.heading)}</h2>{words}'
        f"{legend_html(figure.legend)}{figure.pictures}</section>"
    )


def _robots(summary: FlightSummary, facts: dict[str, Any]) -> str:
    rows = []
    for name, robot in facts["robots"].items():
        syncs = robot["syncs"]
        done = {way: [s for s in syncs if s["direction"] == way] for way in ("in", "out")}
        complete = {w: sum(s["outcome"] == "complete" for s in done[w]) for w in done}
        ages = [age for _, age in robot["age_s"]]
        share = robot["map_share"][-1][1] if robot["map_share"] else None
        reach_s = sum(c["to_s"] - c["from_s"] for c in robot["contacts"])
        key = f'<i class="key {robot_css(summary, name)}"></i>'
        rows.append(
            (
                f"{key}{escape(name)}",
                str(robot["found"]),
                f"{len(robot['contacts'])}, {clock(reach_s)}",
                f"{complete['in']}/{len(done['in'])}",
                f"{complete['out']}/{len(done['out'])}",
                size_words(sum(s["bytes"] for s in syncs)),
                f"{max(ages):.0f} s" if ages else "never heard",
                "" if not share else f"{share:.0%}",
            )
        )
    head = (
        *("robot", "found when sought", "contacts", "syncs from it", "syncs to it"),
        *("bytes", "oldest news", "its map at the end"),
    )
    return _table("Robots", head, rows, ready=True)


def _requests(summary: FlightSummary) -> list[tuple[str, ...]]:
    answers = {None: "no answer recorded", True: "accepted", False: "refused"}
    return [
        (
            clock(request.t - summary.from_s),
            request.what,
            request.by,
            f"{answers[request.accepted]}{': ' if request.why else ''}{request.why}",
        )
        for request in summary.requests
    ]


def _said(summary: FlightSummary) -> list[tuple[str, ...]]:
    return [(clock(t - summary.from_s), text) for t, text in summary.announcements]


def _failures(summary: FlightSummary) -> list[tuple[str, ...]]:
    return [(clock(t - summary.from_s), text) for t, text in summary.failures]


def _modes(summary: FlightSummary, ulog: UlogTrack | None) -> list[tuple[str, ...]]:
    if ulog is None:
        return []
    return [(clock(max(0.0, t - summary.from_s)), mode) for t, mode in ulog.modes]


def _table(
    heading: str, head: Sequence[str], rows: Iterable[Sequence[str]], *, ready: bool = False
) -> str:
    """A table; `ready`: its cells are HTML already."""
    cells = [[cell if ready else escape(cell) for cell in row] for row in rows]
    if not cells:
        return ""
    top = "".join(f"<th>{escape(word)}</th>" for word in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in cells)
    return (
        f'<section><h2>{escape(heading)}</h2><div class="scroll"><table>'
        f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div></section>"
    )


def _foot(facts: dict[str, Any], source: str, ulog: UlogTrack | None) -> str:
    versions = ", ".join(
        f"{name} {facts['about'][name]}"
        for name in ("air-router", "mavsdk", "python")
        if name in facts["about"]
    )
    words = [f"Made from {source}.", f"Recorded by {versions}." if versions else ""]
    if ulog is not None:
        words.append(
            f"PX4's log is aligned by {ulog.aligned_by}; the tracks are {ulog.off_m} m apart "
            "(median)."
        )
    return f"<footer>{escape(' '.join(words))}</footer>"
