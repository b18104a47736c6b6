"""The figures of one flight, each in two widths."""

from collections.abc import Callable, Sequence
from html import escape
from typing import Any, Final, NamedTuple

from air_router.controller.model.states import State
from air_router.report.flight.flight_summary import FlightSummary
from air_router.report.flight.svg import (
    BOTTOM,
    LEFT,
    NARROW,
    RIGHT,
    TOP,
    WIDE,
    Plot,
    Series,
    clock,
    number,
)
from air_router.report.flight.ulog import UlogTrack

COLOURS: Final = 8
"""So many robots have a colour of their own; then they begin anew."""

_LANE: Final = 20
_QUARTERS: Final = (0, 25, 50, 75, 100)  # of a hundred

_LEAST_PX: Final = 1.0
"""Syncs that are nearer to each other than this are one mark."""


class Figure(NamedTuple):
    """A figure of the page: its heading, what it shows, the pictures, and (css, words) of it."""

    name: str  # id on the page
    heading: str
    words: str  # below the heading
    pictures: str  # SVG
    legend: list[tuple[str, str]]  # css class, words


class Line(NamedTuple):
    """A line of a figure over time; with `steps` each value stays until the next."""

    series: Series
    css: str
    title: str
    steps: bool = False


def figures(summary: FlightSummary, ulog: UlogTrack | None = None) -> list[Figure]:
    """Everything that can be drawn of a flight over time."""
    drawn = [
        _timeline(summary),
        _bandwidth(summary),
        _ages(summary),
        _map(summary),
        _distance(summary),
        _battery(summary, ulog),
    ]
    return [figure for figure in drawn if figure is not None]


def robot_css(summary: FlightSummary, robot: str) -> str:
    """The colour of a robot."""
    return f"r{summary.exchanges.names().index(robot) % COLOURS}"


def _both(draw: Callable[[int], str]) -> str:
    return draw(WIDE) + draw(NARROW)


def _timeline(summary: FlightSummary) -> Figure:
    names = summary.exchanges.names()

    def draw(width: int) -> str:
        height = TOP + (_LANE + 6) * (len(names) + 1) + BOTTOM
        plot = Plot(width, height, summary.from_s, summary.to_s)
        for stay in summary.states:
            whom = f" {stay.robot}" if stay.robot else ""
            length = clock(stay.to_s - stay.from_s)
            title = f"{stay.state}{whom}, {length}, because {stay.because or 'the record begins'}"
            plot.bar(stay.from_s, stay.to_s, (TOP, _LANE), f"state {stay.state}", title)
            room = plot.x(stay.to_s) - plot.x(stay.from_s)
            words = stay.state if room < 7 * len(stay.state + whom) + 8 else stay.state + whom
            if room > 7 * len(words) + 8:
                middle = (plot.x(stay.from_s) + plot.x(stay.to_s)) / 2
                plot.text(middle, TOP + 14, words, "middle", "on")
        for row, name in enumerate(names, start=1):
            top = TOP + row * (_LANE + 6)
            _lane(summary, plot, name, top)
        plot.times()
        return plot.svg("states, contacts and syncs over time")

    states = [
        (f"state {s.name}", s.name) for s in State if any(x.state == s.name for x in summary.states)
    ]
    legend = [
        *states,
        ("contact", "in reach"),
        ("sync complete", "sync"),
        ("sync broken", "broken off"),
    ]
    return Figure(
        "timeline",
        "States, contacts and syncs",
        "Above: what the mission was doing. Below, for each robot: when the radio heard it well "
        "enough, and the syncs: ours from it in the upper half, its from us in the lower.",
        _both(draw),
        legend,
    )


def _lane(summary: FlightSummary, plot: Plot, name: str, top: float) -> None:
    plot.text(LEFT - 6, top + 14, name[:8], "end")
    bottom = top + _LANE
    plot.add(f'<path class="grid" d="M{LEFT} {bottom:.1f}H{plot.width - RIGHT}"/>')
    for contact in summary.exchanges.contacts:
        if contact.robot == name:
            title = f"{name} in reach for {clock(contact.to_s - contact.from_s)}"
            plot.bar(contact.from_s, contact.to_s, (top, _LANE), "contact", title)
    drawn: dict[tuple[str, str], float] = {}
    for sync in summary.exchanges.syncs:
        if sync.robot != name:
            continue
        kind, end = (sync.direction, sync.outcome), plot.x(sync.to_s)
        if end - drawn.get(kind, 0.0) >= _LEAST_PX:
            drawn[kind] = end
            half = top + 1 if sync.direction == "in" else top + _LANE / 2 + 1
            css = "sync broken" if sync.outcome == "broken off" else f"sync {sync.outcome}"
            whose = f"from {name}" if sync.direction == "in" else f"to {name}"
            title = f"{sync.outcome} {whose}: {sync.messages} messages, {number(sync.bytes)} bytes"
            plot.bar(sync.from_s, sync.to_s, (half, _LANE / 2 - 2), css, title)


def _bandwidth(summary: FlightSummary) -> Figure | None:
    if not summary.exchanges.syncs:
        return None
    span_s, coming, going = summary.exchanges.bandwidth(summary.from_s, summary.to_s)
    highest, lowest = 1.08 * max(coming) / 1e3, 1.08 * max(going) / 1e3
    least = max(0.2 * (highest + lowest), 1e-3)

    def draw(width: int) -> str:
        top, bottom = max(highest, least), -max(lowest, least)
        plot = Plot(width, 220, summary.from_s, summary.to_s, top, bottom)
        zero = plot.y(0.0)
        for i, (got, given) in enumerate(zip(coming, going, strict=True)):
            begin_s = summary.from_s + i * span_s
            for rate, css in ((got / 1e3, "in"), (-given / 1e3, "out")):
                if rate:
                    y = plot.y(rate)
                    title = f"{clock(begin_s - summary.from_s)}: {abs(rate):.1f} kB/s {css}"
                    place = (min(y, zero), max(abs(y - zero), 1.0))
                    plot.bar(begin_s, begin_s + span_s, place, f"rate {css}", title)
        plot.axes()
        plot.add(f'<path class="axis" d="M{LEFT} {zero:.1f}H{width - RIGHT}"/>')
        return plot.svg("bandwidth over time")

    return Figure(
        "bandwidth",
        "Bandwidth, kB/s",
        f"Bytes of messages in complete and partial syncs, over spans of {span_s:.1f} s: fetched "
        "by us upwards, fetched from us downwards.",
        _both(draw),
        [("rate in", "from robots"), ("rate out", "to robots")],
    )


def _graph(
    summary: FlightSummary, height: int, top: float, label: str, lines: Sequence[Line], **axes: Any
) -> str:
    """Lines over time, in both widths; `axes` may have `ticks`, and a `level` with its words."""

    def draw(width: int) -> str:
        plot = Plot(width, height, summary.from_s, summary.to_s, top)
        plot.axes(axes.get("ticks"))
        for line in lines:
            plot.line(line.series, line.css, line.title, steps=line.steps)
        if axes.get("level") is not None:
            value, words = axes["level"]
            plot.level(value, "limit", words)
        return plot.svg(f"{label} over time")

    return _both(draw)


def _ages(summary: FlightSummary) -> Figure | None:
    ages = {name: summary.exchanges.ages(name) for name in summary.exchanges.names()}
    highest = max((age for series in ages.values() for _, age in series), default=0.0)
    if highest <= 0:
        return None
    lines = [Line(series, robot_css(summary, name), name) for name, series in ages.items()]
    return Figure(
        "ages",
        "Age of information, s",
        "How old the newest message was that we held of each robot's own, from it or through "
        "others. It grows by a second each second until something newer comes.",
        _graph(summary, 220, highest * 1.05, "age of information", lines),
        [(line.css, line.title) for line in lines if line.series],
    )


def _map(summary: FlightSummary) -> Figure | None:
    shares = {n: summary.exchanges.shares(n, summary.painted) for n in summary.exchanges.names()}
    shares = {n: series for n, series in shares.items() if any(share for _, share in series)}
    if not summary.painted:
        return None
    most = max(cells for _, cells in summary.painted)
    own = [(t, 100 * cells / most) for t, cells in summary.painted]
    lines = [Line(own, "own", "the UAV's map")]
    for name, series in shares.items():
        held = zip(series, summary.painted, strict=True)
        part = [(t, 100 * share * cells / most) for (t, share), (_, cells) in held]
        lines.append(Line(part, robot_css(summary, name), f"{name} has", steps=True))
    return Figure(
        "map",
        "Map coverage, %",
        f"Of the {number(most)} cells that the UAV had painted at the end: how many it had, and "
        "how many are in the map that each robot is known to hold: reported by the robot, or "
        "fetched by it. What robots hand to each other is seen when the UAV meets them again.",
        _graph(summary, 220, 100.0, "map coverage", lines, ticks=_QUARTERS),
        [("own", "the UAV"), *((robot_css(summary, n), n) for n in shares)],
    )


def _distance(summary: FlightSummary) -> Figure | None:
    if not summary.distances or summary.setup is None:
        return None
    clearance_m = summary.setup.mission.planner.clearance_m
    top = max(3 * clearance_m, min(60.0, max(d for _, d in summary.distances)))
    label = "distance to the nearest zone or fence"
    lines, level = (
        [Line(summary.distances, "own", label)],
        (clearance_m, f"clearance {clearance_m:g} m"),
    )
    return Figure(
        "distance",
        "Distance to the nearest zone or fence, m",
        "From the vehicle's own positions, while it was ours to fly.",
        _graph(summary, 180, top, label, lines, level=level),
        [],
    )


def _battery(summary: FlightSummary, ulog: UlogTrack | None) -> Figure | None:
    theirs = [] if ulog is None else [(t, 100 * charge) for t, charge in ulog.battery]
    if not summary.battery and not theirs:
        return None
    end = [] if not summary.battery else [(summary.to_s, summary.battery[-1][1])]
    ours = [(t, 100 * charge) for t, charge in (*summary.battery, *end)]
    lines = [Line(theirs, "theirs", "PX4's log"), Line(ours, "own", "telemetry", steps=True)]
    level = None
    if summary.setup is not None:
        reserve = 100 * summary.setup.mission.battery_reserve
        level = (reserve, f"reserve {reserve:g} %")
    pictures = _graph(summary, 160, 100.0, "battery", lines, ticks=_QUARTERS, level=level)
    legend = [("own", "telemetry"), ("theirs", "in PX4's log")] if theirs else []
    return Figure("battery", "Battery, %", "", pictures, legend)


def legend_html(legend: list[tuple[str, str]]) -> str:
    """The legend of a figure."""
    items = "".join(f'<li><i class="key {css}"></i>{escape(words)}</li>' for css, words in legend)
    return f'<ul class="legend">{items}</ul>' if items else ""
