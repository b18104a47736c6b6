"""What can be drawn of a flight over time, each in two widths."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from air_router.controller.model import State
from air_router.report.flight_summary import FlightSummary
from air_router.report.svg import (
    BOTTOM,
    LEFT,
    TOP,
    Plot,
    Series,
    clock,
    in_both_widths,
    number,
)

COLOURS: Final = 8
"""So many robots have a colour of their own; then they begin anew."""

_LANE: Final = 20
_QUARTERS: Final = (0, 25, 50, 75, 100)  # of a hundred

_LEAST_PX: Final = 1.0
"""Syncs that are nearer to each other than this are one mark."""

_FAR_M: Final = 60.0  # from zones and fence: farther is seldom drawn

Legend = Sequence[tuple[str, str]]
"""What stands for what: the class of the style sheet, and words."""


class Figure(NamedTuple):
    """A figure of the page: its heading, what it shows, the pictures, and the legend."""

    name: str  # id on the page
    heading: str
    words: str  # below the heading
    pictures: str  # SVG
    legend: Legend


class Line(NamedTuple):
    """A line of a figure over time; with `steps` each value stays until the next."""

    series: Series
    css: str
    title: str
    steps: bool = False


def figures(summary: FlightSummary) -> list[Figure]:
    """Everything that can be drawn of a flight over time."""
    graphs = (_bandwidth, _ages, _map, _distance, _battery)
    drawn = [_timeline(summary), *(graph(summary) for graph in graphs)]
    return [figure for figure in drawn if figure is not None]


def robot_css(summary: FlightSummary, robot: str) -> str:
    """The colour of a robot."""
    return f"r{summary.exchanges.names.index(robot) % COLOURS}"


def _graph(  # noqa: PLR0913 - what a figure of lines has
    summary: FlightSummary,
    name: str,
    heading: str,
    words: str,
    lines: Sequence[Line],
    *,
    height: int = 220,
    top: float = 100.0,
    legend: Legend = (),
    limit: tuple[float, str] | None = None,
) -> Figure:
    """A figure of lines up to the value `top`; the limit is drawn across it, with words."""

    def draw(width: int) -> str:
        plot = Plot(width, height, summary.from_s, summary.to_s, top)
        plot.axes(_QUARTERS if heading.endswith("%") else None)
        for line in lines:
            plot.line(line.series, line.css, line.title, steps=line.steps)
        if limit is not None:
            plot.level(*limit)
        return plot.svg(f"{heading.partition(',')[0].lower()} over time")

    return Figure(name, heading, words, in_both_widths(draw), legend)


def _ages(summary: FlightSummary) -> Figure | None:
    ages = {name: summary.exchanges.ages(name) for name in summary.exchanges.names}
    highest_s = max((age for series in ages.values() for _, age in series), default=0.0)
    if highest_s <= 0:
        return None
    lines = [Line(series, robot_css(summary, name), name) for name, series in ages.items()]
    return _graph(
        summary,
        "ages",
        "Age of information, s",
        "How old the newest message was that we held of each robot's own, from it or through "
        "others. It grows by a second each second until something newer comes.",
        lines,
        top=highest_s * 1.05,
        legend=[(line.css, line.title) for line in lines if line.series],
    )


def _map(summary: FlightSummary) -> Figure | None:
    if not summary.painted:
        return None
    most = max(cells for _, cells in summary.painted)
    lines = [Line([(t, 100 * n / most) for t, n in summary.painted], "own", "the UAV's map")]
    legend = [("own", "the UAV")]
    for name in summary.exchanges.names:
        shares = summary.exchanges.shares(name, summary.painted)
        if any(share for _, share in shares):
            held = zip(shares, summary.painted, strict=True)
            part = [(t, 100 * share * cells / most) for (t, share), (_, cells) in held]
            lines.append(Line(part, robot_css(summary, name), f"{name} has", steps=True))
            legend.append((robot_css(summary, name), name))
    return _graph(
        summary,
        "map",
        "Map coverage, %",
        f"Of the {number(most)} cells that the UAV had painted at the end: how many it had, and "
        "how many are in the map that each robot is known to hold: reported by the robot, or "
        "fetched by it. What robots hand to each other is seen when the UAV meets them again.",
        lines,
        legend=legend,
    )


def _distance(summary: FlightSummary) -> Figure | None:
    if not summary.distances:
        return None
    clearance_m = summary.setup.mission.planner.clearance_m
    distances_m = [away_m for _, away_m in summary.distances]
    nearest_m, farthest_m = min(distances_m), max(distances_m)
    # What is near is to be told apart, also where the vehicle was far away now and then.
    top_m = max(3 * clearance_m, min(farthest_m, max(_FAR_M, 2 * nearest_m)))
    words = "From the vehicle's own positions, while it was ours to fly."
    if farthest_m > top_m:
        words += f" What is farther than {top_m:.0f} m lies on the upper border."
    return _graph(
        summary,
        "distance",
        "Distance to the nearest zone or fence, m",
        words,
        [Line(summary.distances, "own", "distance to the nearest zone or fence")],
        height=180,
        top=top_m,
        limit=(clearance_m, f"clearance {clearance_m:g} m"),
    )


def _battery(summary: FlightSummary) -> Figure | None:
    if not summary.battery:
        return None
    end = (summary.to_s, summary.battery[-1][1])
    charges = [(t, 100 * charge) for t, charge in (*summary.battery, end)]
    reserve = 100 * summary.setup.mission.battery_reserve
    lines = [Line(charges, "own", "battery", steps=True)]
    limit = reserve, f"reserve {reserve:g}%"
    return _graph(summary, "battery", "Battery, %", "", lines, height=160, limit=limit)


def _timeline(summary: FlightSummary) -> Figure:
    names = summary.exchanges.names

    def draw(width: int) -> str:
        height = TOP + (_LANE + 6) * (len(names) + 1) + BOTTOM
        plot = Plot(width, height, summary.from_s, summary.to_s)
        _states(summary, plot)
        for row, name in enumerate(names, start=1):
            _lane(summary, plot, name, TOP + row * (_LANE + 6))
        plot.times()
        return plot.svg("states, contacts and syncs over time")

    visited = {stay.state for stay in summary.states}
    states = [(f"state {s.name}", s.name) for s in State if s.name in visited]
    links = [("contact", "in reach"), ("sync complete", "sync"), ("sync broken", "broken off")]
    return Figure(
        "timeline",
        "States, contacts and syncs",
        "Above: what the mission was doing. Below, for each robot: when the radio heard it well "
        "enough, and the syncs: ours from it in the upper half, its from us in the lower.",
        in_both_widths(draw),
        [*states, *links],
    )


def _states(summary: FlightSummary, plot: Plot) -> None:
    """What the mission was doing, with its name where there is room."""
    for stay in summary.states:
        whom = f" {stay.robot}" if stay.robot else ""
        length = clock(stay.to_s - stay.from_s)
        title = f"{stay.state}{whom}, {length}, because {stay.because or 'the record begins'}"
        plot.bar(stay.from_s, stay.to_s, (TOP, _LANE), f"state {stay.state}", title)
        room_px = plot.x(stay.to_s) - plot.x(stay.from_s)
        fitting = (
            words for words in (stay.state + whom, stay.state) if room_px > 7 * len(words) + 8
        )
        middle = (plot.x(stay.from_s) + plot.x(stay.to_s)) / 2
        plot.text(middle, TOP + 14.0, next(fitting, ""), "middle", "on")


def _lane(summary: FlightSummary, plot: Plot, name: str, top: float) -> None:
    """When one robot was in reach, and its syncs."""
    plot.text(LEFT - 6, top + 14.0, name[:8], "end")
    plot.across(top + _LANE, "grid")
    for contact in summary.exchanges.links.contacts:
        if contact.robot == name:
            title = f"{name} in reach for {clock(contact.to_s - contact.from_s)}"
            plot.bar(contact.from_s, contact.to_s, (top, _LANE), "contact", title)
    drawn: dict[tuple[str, str], float] = {}
    for sync in summary.exchanges.links.syncs:
        kind, end = (sync.direction, sync.outcome), plot.x(sync.to_s)
        if sync.robot != name or end - drawn.get(kind, 0.0) < _LEAST_PX:
            continue
        drawn[kind] = end
        coming = sync.direction == "in"
        place = (top + 1 if coming else top + _LANE / 2 + 1, _LANE / 2 - 2)
        css = "sync broken" if sync.outcome == "broken off" else f"sync {sync.outcome}"
        whose = f"from {name}" if coming else f"to {name}"
        title = f"{sync.outcome} {whose}: {sync.messages} messages, {number(sync.bytes)} bytes"
        plot.bar(sync.from_s, sync.to_s, place, css, title)


def _bandwidth(summary: FlightSummary) -> Figure | None:
    if not summary.exchanges.links.syncs:
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
        plot.across(zero, "axis")
        return plot.svg("bandwidth over time")

    return Figure(
        "bandwidth",
        "Bandwidth, kB/s",
        f"Bytes of messages in complete and partial syncs, over spans of {span_s:.1f} s: fetched "
        "by us upwards, fetched from us downwards.",
        in_both_widths(draw),
        [("rate in", "from robots"), ("rate out", "to robots")],
    )
