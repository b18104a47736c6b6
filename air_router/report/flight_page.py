"""A flight as one HTML page that needs nothing else: no network, no script."""

import contextlib
import time
from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources
from typing import Any

from air_router.report.charts import Figure, figures, robot_css
from air_router.report.flight_summary import FlightSummary
from air_router.report.flight_table import size_words
from air_router.report.svg import clock, style_sheet
from air_router.report.track import track_figure


def page_of(summary: FlightSummary, source: str) -> str:
    """The page; `source` is the name of the record."""
    facts = summary.as_json()
    title = f"{facts['mission']}: flight of {facts['uav'] or 'the UAV'}"
    sheet = resources.files("air_router.report").joinpath("flight_page.css").read_text("utf-8")
    body = [
        _head(facts, title),
        _tiles(facts),
        *map(_section, (track_figure(summary), *figures(summary))),
        _robots(summary, facts),
        *(_table(*part) for part in _what_was_said(summary)),
        _foot(facts, source),
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{escape(title)}</title><style>{style_sheet()}{sheet}</style></head>"
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
    """The flight in a few numbers."""
    closest, exchanged = facts["closest_approach_m"], facts["interactions"]
    share, got, given = (exchanged[key] for key in ("share_completed", "bytes_in", "bytes_out"))
    charges = [charge for _, charge in facts["battery"]]
    why = facts["flight_report"].get("came_home_because")
    tiles = [
        ("outcome", str(facts["outcome"]), str(why or "")),
        ("flown", clock(facts["duration_s"]), f"{facts['distance_m']:.0f} m"),
        ("closest approach", "none", "no zones, no fence")
        if closest is None
        else (
            "closest approach",
            f"{closest:.1f} m",
            f"to {facts['closest_approach_to']}; demanded {facts['clearance_m']:g} m",
        ),
        (
            "syncs completed",
            "none" if share is None else f"{share:.1%}",
            f"{exchanged['completed']} of {exchanged['started']} begun",
        ),
        ("exchanged", size_words(got + given), f"{size_words(got)} in, {size_words(given)} out"),
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
    items = "".join(
        f'<li><i class="key {css}"></i>{escape(meaning)}</li>' for css, meaning in figure.legend
    )
    legend = f'<ul class="legend">{items}</ul>' if items else ""
    return (
        f'<section id="{figure.name}"><h2>{escape(figure.heading)}</h2>{words}'
        f"{legend}{figure.pictures}</section>"
    )


def _robots(summary: FlightSummary, facts: dict[str, Any]) -> str:
    rows = []
    for name, robot in facts["robots"].items():
        syncs = robot["syncs"]
        ways = [[s["outcome"] for s in syncs if s["direction"] == way] for way in ("in", "out")]
        ages_s = [age_s for _, age_s in robot["age_s"]]
        share = robot["map_share"][-1][1] if robot["map_share"] else None
        reach_s = sum(c["to_s"] - c["from_s"] for c in robot["contacts"])
        rows.append(
            (
                f'<i class="key {robot_css(summary, name)}"></i>{escape(name)}',
                str(robot["found"]),
                f"{len(robot['contacts'])}, {clock(reach_s)}",
                *(f"{way.count('complete')}/{len(way)}" for way in ways),
                size_words(sum(s["bytes"] for s in syncs)),
                f"{max(ages_s):.0f} s" if ages_s else "never heard",
                "" if not share else f"{share:.0%}",
            )
        )
    head = (
        *("robot", "found when sought", "contacts", "syncs from it", "syncs to it"),
        *("bytes", "oldest news", "its map at the end"),
    )
    return _table("Robots", head, rows, ready=True)


def _what_was_said(
    summary: FlightSummary,
) -> Iterable[tuple[str, tuple[str, ...], list[tuple[str, ...]]]]:
    """Tables of what happened at one moment each: heading, columns and rows."""

    def at(t: float) -> str:
        return clock(max(0.0, t - summary.from_s))

    waited: dict[tuple[str, str], list[float]] = {}
    for wait in summary.waits:
        waited.setdefault((wait.interlock, wait.why), []).append(wait.to_s - wait.from_s)
    yield (
        "What kept the mission waiting",
        ("why", "interlock", "times", "in all"),
        [
            (why, interlock, str(len(spans)), f"{sum(spans):.1f} s")
            for (interlock, why), spans in waited.items()
        ],
    )
    answers = {None: "no answer recorded", True: "accepted", False: "refused"}
    requests: list[tuple[str, ...]] = [
        (at(r.t), r.what, r.by, f"{answers[r.accepted]}{': ' if r.why else ''}{r.why}")
        for r in summary.requests
    ]
    yield "Requests", ("at", "what", "who", "answer"), requests
    announced: list[tuple[str, ...]] = [
        (at(t), severity, said) for t, severity, said in summary.announcements
    ]
    yield "Announcements", ("at", "severity", "text"), announced
    yield "Commands not followed", ("at", "what"), [(at(t), what) for t, what in summary.failures]


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


def _foot(facts: dict[str, Any], source: str) -> str:
    about = facts["about"]
    known = [name for name in ("air-router", "mavsdk", "python") if name in about]
    versions = ", ".join(f"{name} {about[name]}" for name in known)
    words = [f"Made from {source}.", f"Recorded by {versions}." if versions else ""]
    return f"<footer>{escape(' '.join(words))}</footer>"
