"""A flight as a self-contained HTML page, without network or scripts.

Needs jinja2 and matplotlib.
"""

import contextlib
import time
from collections.abc import Sequence
from importlib import resources
from typing import Any, Final, NamedTuple

from air_router.report.charts import figures, robot_colour
from air_router.report.figure_style import colours
from air_router.report.flight_history import FlightHistory
from air_router.report.flight_table import clock, size_words
from air_router.report.track import track_figure
from mocha_link.errors import needs_extra
from mocha_link.sanitize import sanitize

with needs_extra("a report", "plot", "air-router"):
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

_OUTCOMES: Final = {
    "done": "completed",
    "pilot": "pilot took over",
    "failsafe": "autopilot failsafe",
}
"""Texts for outcomes of programs; other outcomes are sentences already."""

_BY_REQUEST: Final = "'s request"
_VERSIONS: Final = ("air-router", "mavsdk", "python")
_ANSWERS: Final = {None: "no answer recorded", True: "accepted", False: "refused"}


class Tile(NamedTuple):
    """One figure of the flight; `bad`: it violates its requirement."""

    name: str
    value: str
    more: str
    bad: bool = False


class Row(NamedTuple):
    """A row of a table; `colour`: the name of its color in the figures."""

    cells: Sequence[str]
    colour: str = ""


class Table(NamedTuple):
    """A table of the page, omitted if it has no rows."""

    heading: str
    columns: Sequence[str]
    rows: Sequence[Row]


def page_of(history: FlightHistory, source: str) -> str:
    """The page; `source` is the name of the record."""
    environment = Environment(
        loader=PackageLoader("air_router.report"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_printable,
        keep_trailing_newline=True,
    )
    style = resources.files("air_router.report").joinpath("templates/flight_page.css")
    return environment.get_template("flight_page.html").render(
        title=f"{history.setup.mission.name}: flight of {history.setup.name or 'the UAV'}",
        style=Markup(style.read_text("utf-8")),  # noqa: S704 - ours
        light=colours(),
        dark=colours(dark=True),
        facts=_facts(history),
        ending=history.ending,
        tiles=_tiles(history),
        figures=[track_figure(history), *figures(history)],
        tables=[_robots(history), _waits(history), _requests(history), *_events(history)],
        source=source,
        versions=[f"{name} {history.about[name]}" for name in _VERSIONS if name in history.about],
    )


def _printable(value: Any) -> Any:
    """External text without control characters, such as changes of the writing direction."""
    return sanitize(value) if type(value) is str else value


def _facts(history: FlightHistory) -> list[str]:
    facts = []
    if history.began_unix_s is not None:
        with contextlib.suppress(OverflowError, OSError, ValueError):  # an invalid time
            began = time.gmtime(history.began_unix_s)
            facts.append(time.strftime("%Y-%m-%d %H:%M UTC", began))
    if history.vehicle:
        facts.append(f"{history.vehicle.get('autopilot')} {history.vehicle.get('version')}")
    return facts


def _tiles(history: FlightHistory) -> list[Tile]:
    """The flight in a few figures."""
    totals, exchanged = history.totals, history.links.interactions()
    share, got, given = (exchanged[key] for key in ("share_completed", "bytes_in", "bytes_out"))
    outcome = history.outcome
    reason = str(history.report.get("came_home_because") or "")
    if reason.endswith(_BY_REQUEST):
        reason = f"returned at {reason}"
    tiles = [
        Tile("outcome", _OUTCOMES.get(outcome, outcome), reason),
        Tile("flight time", clock(totals["duration_s"]), f"{totals['distance_m']:.0f} m flown"),
        _closest(history),
        Tile(
            "syncs completed",
            "none" if share is None else f"{share:.1%}",
            f"{exchanged['completed']} of {exchanged['started']} started",
        ),
        Tile("data exchanged", size_words(got + given),
             f"{size_words(got)} received, {size_words(given)} sent"),
    ]  # fmt: skip
    if history.battery:
        first, last = history.battery[0][1], history.battery[-1][1]
        tiles.append(Tile("battery used", f"{first - last:.0%}", f"from {first:.0%} to {last:.0%}"))
    return tiles


def _closest(history: FlightHistory) -> Tile:
    if history.closest is None:
        return Tile("closest approach", "none", "no zones, no fence")
    (closest_m, what), required_m = history.closest, history.totals["clearance_m"]
    more = f"to {what}; required {required_m:g} m"
    # Rounded like the report: 5.0 m is no violation of a required 5 m.
    bad = round(closest_m, 2) < required_m
    return Tile("closest approach", f"{closest_m:.1f} m", more, bad)


def _robots(history: FlightHistory) -> Table:
    columns = (
        *("robot", "found in searches", "contacts", "syncs from it", "syncs to it"),
        *("data", "oldest data held", "UAV's map it holds at the end"),
    )
    rows = []
    for name in history.links.names:
        syncs = [sync for sync in history.links.syncs if sync.robot == name]
        ways = [[s.outcome for s in syncs if s.direction == way] for way in ("in", "out")]
        spans = [c.to_s - c.from_s for c in history.links.contacts if c.robot == name]
        ages_s = [age_s for _, age_s in history.links.ages[name]]
        share = history.links.map_shares[name][-1][1] if history.links.map_shares[name] else 0.0
        cells = (
            name,
            str(history.found(name)),
            f"{len(spans)}, {clock(sum(spans))}",
            *(f"{way.count('complete')} of {len(way)}" for way in ways),
            size_words(sum(sync.bytes for sync in syncs)),
            f"{max(ages_s):.0f} s" if ages_s else "never received",
            f"{share:.0%}" if share else "none known",
        )
        rows.append(Row(cells, robot_colour(history, name)))
    return Table("Robots", columns, rows)


def _waits(history: FlightHistory) -> Table:
    waited: dict[tuple[str, str], list[float]] = {}
    for wait in history.waits:
        waited.setdefault((wait.why, wait.interlock), []).append(wait.to_s - wait.from_s)
    rows = [
        Row((why, interlock, str(len(spans)), f"{sum(spans):.1f} s"))
        for (why, interlock), spans in waited.items()
    ]
    return Table("Why the mission waited", ("reason", "interlock", "times", "total"), rows)


def _requests(history: FlightHistory) -> Table:
    rows = [
        Row(
            (
                _at(history, request.t),
                request.what,
                request.by,
                f"{_ANSWERS[request.accepted]}{': ' if request.why else ''}{request.why}",
            )
        )
        for request in history.requests
    ]
    return Table("Requests", ("time", "request", "requested by", "answer"), rows)


def _events(history: FlightHistory) -> tuple[Table, Table]:
    announced = [
        Row((_at(history, t), severity, text)) for t, severity, text in history.announcements
    ]
    failed = [Row((_at(history, t), text)) for t, text in history.failures]
    return (
        Table("Announcements", ("time", "severity", "text"), announced),
        Table("Commands not followed", ("time", "command and reason"), failed),
    )


def _at(history: FlightHistory, t: float) -> str:
    return clock(max(0.0, t - history.from_s))
