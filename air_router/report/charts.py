"""Plots of a flight over time: each figure for a wide page and for a phone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from air_router.controller.model import State
from air_router.report.figure_style import PX, colours, embedded, figure_style
from air_router.report.flight_history import FlightHistory
from air_router.report.flight_table import clock
from air_router.report.link_history import Series
from air_router.words import counted
from mocha_link.errors import needs_extra
from mocha_link.sanitize import sanitize

with needs_extra("a picture", "plot", "air-router"):
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure as Drawing
    from matplotlib.ticker import FuncFormatter, MaxNLocator, MultipleLocator

STATE_COLOURS: Final = {
    State.READY: "soft",
    State.INIT: "accent",
    State.EXPL: "accent",
    State.SEARCH: "r4",
    State.COMM: "route",
    State.HOME: "good",
    State.LAND: "good",
    State.DONE: "soft",
    State.PASSIVE: "wrong",
    State.GOTO: "around",
    State.HOLD: "around",
    State.IDLE: "soft",
}
"""Color names of the pages' style sheet, the same as on the live page."""

ROBOT_COLOURS: Final = 8
"""Number of robot colors; after that they repeat."""

WIDE_PX, NARROW_PX = 900, 340
_LEFT_PX, _RIGHT_PX, _TOP_PX, _BOTTOM_PX = 62, 16, 24, 40
_LANE_PX: Final = 26
_TIME_STEPS_S: Final = (5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14_400, 43_200)
_NAME_LETTERS: Final = 8  # of a robot's name beside its lane
_FAR_M: Final = 60.0  # from zones and fence: larger distances are rarely drawn

_SYNC_COLOURS: Final = {"complete": "accent", "partial": "around", "broken off": "wrong"}

Legend = Sequence[tuple[str, str]]
"""The legend: color names with labels."""


class Figure(NamedTuple):
    """A figure of the page."""

    name: str  # id on the page
    heading: str
    caption: str
    svg: str  # one for each width
    legend: Legend = ()


class Frame(NamedTuple):
    """The labels and the height of a chart.

    Attributes:
        label: Its accessible description.
        unit: Unit of its values; "": they are names.
    """

    name: str
    label: str
    unit: str
    height_px: int = 220


class Bar(NamedTuple):
    """A block from one time to another, with its tooltip."""

    from_s: float
    to_s: float
    low: float
    high: float
    colour: str
    tooltip: str


@dataclass(slots=True)
class Chart:
    """A chart with time on the horizontal axis.

    Attributes:
        axes: Matplotlib's axes; the horizontal one is seconds since the start of the record.
        width_px: Width of the whole picture.
    """

    axes: Axes
    width_px: int
    begin_s: float
    tooltips: dict[str, Sequence[str]]

    def bars(self, bars: Sequence[Bar]) -> None:
        """Draw blocks, each wide enough to be visible."""
        low_s, high_s = self.axes.get_xlim()
        seen_s = (high_s - low_s) / self.width_px
        corners = []
        for bar in bars:
            left, right = bar.from_s - self.begin_s, bar.to_s - self.begin_s
            right = max(right, left + seen_s)
            corners.append([(left, bar.low), (right, bar.low), (right, bar.high), (left, bar.high)])
        gid = f"bars{len(self.tooltips)}"
        self.tooltips[gid] = [bar.tooltip for bar in bars]
        shades = [colours()[bar.colour] for bar in bars]
        self.axes.add_collection(
            PolyCollection(corners, facecolors=shades, linewidths=0, gid=gid), autolim=False
        )

    def line(self, series: Series, colour: str, *, steps: bool = False) -> None:
        """Draw a line; with `steps` each value holds until the next."""
        times, values = zip(*series, strict=True) if series else ((), ())
        style: dict[str, Any] = {"drawstyle": "steps-post"} if steps else {}
        since = [t - self.begin_s for t in times]
        self.axes.plot(since, values, color=colours()[colour], **style)

    def limit(self, value: float, label: str) -> None:
        """Draw a horizontal line with a label."""
        self.axes.axhline(value, color=colours()["wrong"], linewidth=1.2, dashes=(5, 3))
        self.text(
            1.0, value, label, transform=self.axes.get_yaxis_transform(), ha="right", va="bottom"
        )

    def text(self, x: float, y: float, label: str, **style: Any) -> Any:
        """Draw a text that is legible over lines."""
        box = {"facecolor": colours()["halo"], "edgecolor": "none", "pad": 1.5, "alpha": 0.8}
        return self.axes.text(x, y, label, color=colours()["ink"], bbox=box, **style)


def figures(history: FlightHistory) -> list[Figure]:
    """All figures of a flight over time."""
    graphs = (_bandwidth, _ages, _map, _distance, _battery)
    drawn = [_timeline(history), *(graph(history) for graph in graphs)]
    return [figure for figure in drawn if figure is not None]


def robot_colour(history: FlightHistory, robot: str) -> str:
    """The color name of a robot."""
    return f"r{history.links.names.index(robot) % ROBOT_COLOURS}"


def in_both_widths(draw: Callable[[str], str]) -> str:
    """Draw a picture for wide pages and one for phones; the style sheet shows one of them."""
    return draw("wide") + draw("narrow")


def _drawn(history: FlightHistory, frame: Frame, draw: Callable[[Chart], None]) -> str:
    """A chart in both widths."""
    name, label, unit, height_px = frame

    def picture(kind: str) -> str:
        width_px = WIDE_PX if kind == "wide" else NARROW_PX
        top_px = _TOP_PX if unit else _TOP_PX / 4
        with figure_style(f"{name}-{kind}"):
            drawing = Drawing(figsize=(width_px * PX, height_px * PX))
            left, bottom = _LEFT_PX / width_px, _BOTTOM_PX / height_px
            width = 1 - left - _RIGHT_PX / width_px
            axes = drawing.add_axes((left, bottom, width, 1 - bottom - top_px / height_px))
            span_s = max(history.to_s - history.from_s, 1.0)
            axes.set_xlim(0, span_s)
            axes.grid(visible=True, axis="y")
            axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
            most = 10 if kind == "wide" else 4
            step_s = next((s for s in _TIME_STEPS_S if span_s / s <= most), None)
            axes.xaxis.set_major_locator(
                MaxNLocator(most) if step_s is None else MultipleLocator(step_s)
            )
            axes.xaxis.set_major_formatter(FuncFormatter(lambda t, _: clock(t)))
            axes.set_xlabel("elapsed time, min:s", loc="right")
            axes.set_title(
                unit, loc="left", x=-left / width, fontsize=11.5, color=colours()["soft"]
            )
            chart = Chart(axes, width_px, history.from_s, {})
            draw(chart)
            return embedded(drawing, kind, label, chart.tooltips)

    return in_both_widths(picture)


def _timeline(history: FlightHistory) -> Figure:
    names = history.links.names
    lanes = {name: len(names) - row for row, name in enumerate(names, start=1)}

    def draw(chart: Chart) -> None:
        axes = chart.axes
        axes.set_ylim(-0.1, len(names) + 1)
        axes.set_yticks(
            [lane + 0.5 for lane in (*lanes.values(), len(names))],
            [*(_short(sanitize(name)) for name in names), "mission"],
        )
        axes.grid(visible=False, axis="y")
        _states(history, chart, len(names))
        chart.bars(
            [
                Bar(c.from_s, c.to_s, lanes[c.robot] + 0.12, lanes[c.robot] + 0.88, "contact",
                    f"{c.robot} in range for {clock(c.to_s - c.from_s)}")
                for c in history.links.contacts
            ]
        )  # fmt: skip
        syncs = []
        for sync in history.links.syncs:
            coming = sync.direction == "in"
            low = lanes[sync.robot] + (0.52 if coming else 0.16)
            way = f"from {sync.robot}" if coming else f"to {sync.robot}"
            moved = f"{counted(sync.messages, 'messages')}, {sync.bytes:,} bytes"
            colour = _SYNC_COLOURS.get(sync.outcome, "wrong")
            tooltip = f"sync {way}, {sync.outcome}: {moved}"
            syncs.append(Bar(sync.from_s, sync.to_s, low, low + 0.32, colour, tooltip))
        chart.bars(syncs)

    height_px = _LANE_PX * (len(names) + 1) + _BOTTOM_PX
    frame = Frame("timeline", "states, contacts and syncs over time", "", height_px)
    caption = (
        "Top row: the mission's state. Below, one row per robot: shaded while the radio link was "
    )
    caption += "usable; syncs from the robot in the upper half, syncs to the robot in the lower."
    visited = {stay.state for stay in history.states}
    outcomes = {sync.outcome for sync in history.links.syncs}
    labels = {"complete": "sync completed", "partial": "sync partial", "broken off": "sync lost"}
    alike: dict[str, list[str]] = {}  # states, by their colour
    for state, colour in STATE_COLOURS.items():
        if state.name in visited:
            alike.setdefault(colour, []).append(state.name)
    return Figure(
        "timeline",
        "States, contacts and syncs",
        caption if names else "The mission's state.",
        _drawn(history, frame, draw),
        [
            *((colour, ", ".join(states)) for colour, states in alike.items()),
            *([("contact", "in range")] if history.links.contacts else []),
            *((_SYNC_COLOURS[o], label) for o, label in labels.items() if o in outcomes),
        ],
    )


def _states(history: FlightHistory, chart: Chart, lane: int) -> None:
    """Draw the mission's states, with names if they fit."""
    bars = []
    for stay in history.states:
        robot = f" {stay.robot}" if stay.robot else ""
        length = clock(stay.to_s - stay.from_s)
        tooltip = f"{stay.state}{robot}, {length}: {stay.because or 'the record begins'}"
        colour = STATE_COLOURS.get(State.__members__.get(stay.state, State.IDLE), "soft")
        bars.append(Bar(stay.from_s, stay.to_s, lane + 0.08, lane + 0.92, colour, tooltip))
    chart.bars(bars)
    left, right = chart.axes.get_xlim()
    for stay in history.states:
        ends = [min(max(t - history.from_s, left), right) for t in (stay.from_s, stay.to_s)]
        (x, _), (end, _) = chart.axes.transData.transform([(t, 0.0) for t in ends])
        text = chart.axes.text(
            sum(ends) / 2, lane + 0.5, stay.state, ha="center", va="center_baseline",
            fontsize=10.5 if chart.width_px == WIDE_PX else 9.5, fontweight="bold",
            color=colours()["on-state"],
        )  # fmt: skip
        for label in (f"{stay.state} {stay.robot}" if stay.robot else stay.state, stay.state, ""):
            text.set_text(label)
            if not label or text.get_window_extent().width < end - x - 2:
                break


def _short(name: str) -> str:
    return name if len(name) <= _NAME_LETTERS else f"{name[: _NAME_LETTERS - 1]}…"


def _bandwidth(history: FlightHistory) -> Figure | None:
    if not history.links.syncs:
        return None
    span_s, coming, going = history.links.bandwidth(history.from_s, history.to_s)
    highest, lowest = 1.08 * max(coming) / 1e3, 1.08 * max(going) / 1e3
    least = max(0.2 * (highest + lowest), 1e-3)

    def draw(chart: Chart) -> None:
        bars = []
        for i, (got, given) in enumerate(zip(coming, going, strict=True)):
            begin_s = history.from_s + i * span_s
            at = clock(begin_s - history.from_s)
            for rate, colour, way in ((got / 1e3, "accent", "in"), (-given / 1e3, "around", "out")):
                if rate:
                    tooltip = f"{at}: {abs(rate):.1f} kB/s {way}"
                    low, high = min(rate, 0.0), max(rate, 0.0)
                    bars.append(Bar(begin_s, begin_s + span_s, low, high, colour, tooltip))
        chart.axes.set_ylim(-max(lowest, least), max(highest, least))
        chart.axes.yaxis.set_major_formatter(FuncFormatter(lambda rate, _: f"{abs(rate):g}"))
        chart.bars(bars)
        chart.axes.axhline(0.0, color=colours()["soft"], linewidth=0.8)

    return Figure(
        "bandwidth",
        "Bandwidth",
        f"Message bytes of completed and partial syncs, averaged over {span_s:.1f} s: received "
        "from robots upwards, sent to robots downwards.",
        _drawn(history, Frame("bandwidth", "bandwidth over time", "kB/s"), draw),
        [("accent", "from robots"), ("around", "to robots")],
    )


def _ages(history: FlightHistory) -> Figure | None:
    ages = history.links.ages
    highest_s = max((age for series in ages.values() for _, age in series), default=0.0)
    if highest_s <= 0:
        return None

    def draw(chart: Chart) -> None:
        chart.axes.set_ylim(0.0, highest_s * 1.05)
        for name, series in ages.items():
            chart.line(series, robot_colour(history, name))

    return Figure(
        "ages",
        "Age of information",
        "Age of the newest message held from each robot, received directly or through others. It "
        "grows until a newer message arrives.",
        _drawn(history, Frame("ages", "age of information over time", "s"), draw),
        [(robot_colour(history, name), name) for name, series in ages.items() if series],
    )


def _map(history: FlightHistory) -> Figure | None:
    most = max((cells for _, cells in history.painted), default=0)
    if not most:
        return None
    times = [t for t, _ in history.painted]
    own = [100 * cells / most for _, cells in history.painted]
    known = {
        name: [100 * share * cells / most for (_, share), (_, cells)
               in zip(shares, history.painted, strict=True)]
        for name, shares in history.links.map_shares.items()
        if any(share for _, share in shares)
    }  # fmt: skip

    def draw(chart: Chart) -> None:
        chart.axes.set_ylim(0.0, 104.0)
        chart.line([*zip(times, own, strict=True)], "accent")
        for name, held in known.items():
            chart.line([*zip(times, held, strict=True)], robot_colour(history, name), steps=True)

    return Figure(
        "map",
        "Map coverage",
        f"Share of the {most:,} cells that the UAV had mapped by the end: its own, and what each "
        "robot is known to hold, because it reported so or fetched it. What robots pass on among "
        "themselves shows when the UAV meets them again.",
        _drawn(history, Frame("map", "map coverage over time", "%"), draw),
        [("accent", "the UAV"), *((robot_colour(history, name), name) for name in known)],
    )


def _distance(history: FlightHistory) -> Figure | None:
    if not history.distances:
        return None
    clearance_m = history.mission.planner.clearance_m
    distances_m = [away_m for _, away_m in history.distances]
    nearest_m, farthest_m = min(distances_m), max(distances_m)
    # Short distances stay legible even if the vehicle was far away at times.
    top_m = max(3 * clearance_m, min(farthest_m, max(_FAR_M, 2 * nearest_m)), 1.0)

    def draw(chart: Chart) -> None:
        chart.axes.set_ylim(0.0, top_m * 1.02)
        chart.line([(t, min(away_m, top_m)) for t, away_m in history.distances], "accent")
        chart.limit(clearance_m, f"clearance {clearance_m:g} m")

    caption = "From the vehicle's own position estimate, while air-router was in control."
    if farthest_m > top_m:
        caption += f" Distances above {top_m:.0f} m are drawn at {top_m:.0f} m."
    label = "distance to the nearest zone or fence over time"
    return Figure(
        "distance",
        "Distance to the nearest zone or fence",
        caption,
        _drawn(history, Frame("distance", label, "m", 200), draw),
    )


def _battery(history: FlightHistory) -> Figure | None:
    if not history.battery:
        return None
    end = (history.to_s, history.battery[-1][1])
    charges = [(t, 100 * charge) for t, charge in (*history.battery, end)]
    reserve = 100 * history.setup.mission.battery_reserve

    def draw(chart: Chart) -> None:
        chart.axes.set_ylim(0.0, 104.0)
        chart.line(charges, "accent", steps=True)
        chart.limit(reserve, f"reserve {reserve:g}%")

    svg = _drawn(history, Frame("battery", "battery over time", "%", 200), draw)
    return Figure("battery", "Battery", "Remaining charge in the air.", svg)
