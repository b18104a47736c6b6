"""The figures of an experiment, drawn from its finished runs. Needs matplotlib.

The colours are those of M. Okabe and K. Ito, which colour-blind readers can tell apart; lines
differ in their dashes too, so the figures can be read in black and white.
"""

from __future__ import annotations

import io
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from air_router.errors import PictureError
from air_router.files import write_whole
from air_router.words import counted
from mocha_link.errors import needs_extra
from sitl.experiment import Experiment, Record, Row, settings_text, value_of
from sitl.experiment.analysis.claims import FLOWN_IN, WITHIN, flown_beside
from sitl.experiment.analysis.link_prediction import MODELS_SHOWN, calibration, of_links
from sitl.experiment.analysis.outcome import OUTCOMES, Scenarios, is_of_scenarios
from sitl.experiment.analysis.statistics import Numbers, Runs, interval
from sitl.experiment.analysis.tables import Line, lines, of_the_paper, readings
from sitl.experiment.engine import BIN_S

with needs_extra("a figure", "experiments", "air-router"):
    import matplotlib as mpl
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine
    from matplotlib.ticker import LogLocator, NullLocator

INK, FAINT = "#30363d", "#7b838b"
COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
DASHES: Final[tuple[Any, ...]] = ("-", (0, (4, 1.6)), (0, (1, 1.2)), (0, (5, 1.5, 1, 1.5)))
_DPI: Final = 140
_STYLE: Final = Path(__file__).with_name("figures.mplstyle")
_MEASURES: Final = (
    ("goals_percent", "goals_percent", "goals reached (%)"),
    ("time_min", "mean_time_min", "time to a goal (min)"),
    ("wait_mean_s", "wait_mean_s", "message wait, mean (s)"),
)
_COMPARED: Final = (
    ("goals_percent", "goals reached (%)"),
    ("goal_area_percent", "goals reached, mean over time (%)"),
    ("pose_age_s", "age of poses at UAVs (s)"),
    ("map_age_s", "age of maps at ground robots (s)"),
    ("wait_mean_s", "message wait, mean (s)"),
    ("sent_mb", "sent (MB)"),
)
_MOST_ROWS: Final = 16
_LEAST_SIZES: Final = 4
_MOST_EXAMPLES: Final = 4
_MOST_LINES: Final = 9
_LEAST_SCENARIOS: Final = 2
_LEAST_POLICIES: Final = 2
_MARKERS: Final = "os^DvPX"
_LEAST_FACTOR: Final = 0.3
"""Factors below are written as numbers."""
_STEP_S: Final = 15.0


def sheet(  # noqa: PLR0913 - how sheets differ
    count: int,
    title: str,
    subtitle: str,
    *,
    high: float = 2.7,
    columns: int = 2,
    one_scale: Literal["all", "row", "none"] = "all",
) -> tuple[Figure, list[Axes]]:
    """A figure with panels, row by row, under one title; each so many inches high.

    What they show upwards has `one_scale` in all of them, in those of each row, or in none.
    """
    columns = min(columns, count)
    rows = -(-count // columns)
    tall = high * rows + 0.75
    layout = ConstrainedLayoutEngine(rect=(0, 0, 1, 1 - 0.55 / tall))
    figure = Figure(figsize=({1: 6.4, 2: 9.6}.get(columns, 10.8), tall), layout=layout)
    figure.text(0.012, 1 - 0.08 / tall, title, va="top", fontsize=12, fontweight="bold")
    figure.text(0.012, 1 - 0.32 / tall, subtitle, va="top", fontsize=8.5, color=FAINT)
    axes = list(figure.subplots(rows, columns, squeeze=False, sharey=one_scale).flat)
    for empty in axes[count:]:
        empty.set_visible(False)
    return figure, axes[:count]


def legend_below(figure: Figure) -> None:
    """One legend for all panels, each of its labels once."""
    handles: dict[str, Any] = {}
    for one in figure.axes:
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    below: dict[str, Any] = {
        "loc": "outside lower center",
        "ncols": 5,
        "fontsize": 8,
        "labelcolor": INK,
    }
    figure.legend(list(handles.values()), list(handles), **below)


def save(figure: Figure, *paths: Path) -> None:
    """Write a figure; the names' endings choose the formats. Raises PictureError."""
    figure.set_dpi(_DPI)
    figure.draw_without_rendering()  # lays it out, once for all formats
    figure.set_layout_engine("none")
    for path in paths:
        try:
            picture = io.BytesIO()
            suffix = path.suffix.removeprefix(".") or None
            figure.savefig(picture, format=suffix, dpi=_DPI, facecolor="white")
            write_whole(path, picture.getvalue(), replace=True)
        except (OSError, ValueError) as error:
            raise PictureError(f"cannot write the figure {path}: {error}") from None


def draw_table(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """The paper's table as curves over the radius, ours beside the paper's."""
    if not of_the_paper(experiment):
        return None
    found = lines(experiment, records)
    sizes = sorted({line.settings["ugvs"] for line in found})
    figure, axes = sheet(
        len(_MEASURES) * len(sizes),
        "Our runs beside the paper's table",
        "Filled, with 95 % confidence intervals: ours. Hollow and dashed: the paper's",
        high=2.4,
        columns=len(sizes),
        one_scale="row",
    )
    for place, (ours, theirs, label) in enumerate(_MEASURES):
        row = axes[place * len(sizes) : (place + 1) * len(sizes)]
        for size, one in zip(sizes, row, strict=True):
            team = [line for line in found if line.settings["ugvs"] == size]
            _draw_team(one, team, ours, theirs)
            one.set(xlabel="radius (m)", ylabel=label)
            one.set_title(counted(size, "ground robots"), loc="left")
        if ours.startswith("wait"):
            row[0].set_yscale("log")
            _label_log(row[0].yaxis)
    legend_below(figure)
    return figure


def _label_log(axis: Axis) -> None:
    """With numbers that people read: 0.2, 0.5, 1, 2."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_minor_locator(NullLocator())


def _draw_team(one: Axes, team: Sequence[Line], ours: str, theirs: str) -> None:
    for uavs, colour, marker, shift in ((1, COLOURS[0], "o", -0.35), (2, COLOURS[1], "s", 0.35)):
        own = sorted(
            (line for line in team if line.settings["uavs"] == uavs),
            key=lambda line: line.settings["radius_m"],
        )
        radii_m = np.array([line.settings["radius_m"] for line in own]) + shift
        style: dict[str, Any] = {"color": colour, "marker": marker, "ms": 5}
        bars: dict[str, Any] = {"lw": 1.6, "elinewidth": 1.1, "capsize": 2.5, "zorder": 3}
        value, low, high = np.array([line.values[ours] for line in own]).reshape(-1, 3).T
        reach = np.maximum(np.nan_to_num([value - low, high - value]), 0)
        team_name = counted(uavs, "UAVs")
        one.errorbar(radii_m, value, yerr=reach, label=f"{team_name}, ours", **style, **bars)
        paper = [getattr(line.paper, theirs) if line.paper else np.nan for line in own]
        hollow: dict[str, Any] = {"ls": (0, (3, 2)), "mfc": "white", "lw": 1, "zorder": 2}
        one.plot(radii_m, paper, label=f"{team_name}, paper", **style, **hollow)


def draw_readings(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """Goals over the radius for each reading of where robots start and vehicles stand."""
    compared = readings(experiment)
    found = {line.label: line for line in lines(experiment, records)}
    if not compared or not all(row.label in found for row in experiment.rows):
        return None

    def team(line: Line) -> tuple[int, int]:
        return line.settings["uavs"], line.settings["ugvs"]

    teams = sorted({team(line) for line in found.values()})
    figure, axes = sheet(
        len(teams),
        "Goals by where robots start and vehicles stand, beside the paper's",
        "Filled, with 95 % confidence intervals: ours. Hollow and dashed: the paper's",
        columns=3,
    )
    for one, (uavs, ugvs) in zip(axes, teams, strict=True):
        paper: dict[float, float] = {}
        for place, (name, rows) in enumerate(compared.items()):
            own = [found[row.label] for row in rows if team(found[row.label]) == (uavs, ugvs)]
            own.sort(key=lambda line: line.settings["radius_m"])
            paper |= {line.paper.radius_m: line.paper.goals_percent for line in own if line.paper}
            shift = 0.5 * (place - (len(compared) - 1) / 2)  # apart, to be seen
            radii_m = np.array([line.settings["radius_m"] for line in own]) + shift
            value, low, high = np.array([line.values["goals_percent"] for line in own]).T
            reach = np.maximum(np.nan_to_num([value - low, high - value]), 0)
            style: dict[str, Any] = {"color": COLOURS[place], "marker": _MARKERS[place], "ms": 4.5}
            style |= {"lw": 1.4, "elinewidth": 1.0, "capsize": 2.5, "label": name}
            one.errorbar(radii_m, value, yerr=reach, **style)
        hollow: dict[str, Any] = {"ls": (0, (3, 2)), "mfc": "white", "color": INK, "marker": "o"}
        one.plot([*paper], [*paper.values()], label="the paper", lw=1.2, zorder=4, **hollow)
        one.set(xlabel="radius (m)", ylabel="goals reached (%)", ylim=(0, 105))
        one.set_title(f"{counted(uavs, 'UAVs')}, {counted(ugvs, 'UGVs')}", loc="left")
    legend_below(figure)
    return figure


_AGES: Final = {
    "service_age_mean_s": "age of poses at UAVs and of maps at robots (s)",
    "exchange_age_mean_s": "age of exchanges (s)",
}
_KNOWN_POLICIES: Final = (
    *("round robin", "tour", "rendezvous", "freshest", "milp", "oracle", "orienteering"),
)
"""Each has its colour in every figure."""


def draw_policies(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """How old data are with each policy, scenario by scenario."""
    runs = Runs(experiment, records)
    measure = next((each for each in _AGES if runs.has(each)), None)
    if "policy" not in experiment.varied or measure is None or is_of_scenarios(experiment):
        return None
    rows = [row for row in experiment.rows if len(runs.numbers(row)) > 1]
    policies = list(dict.fromkeys(map(_policy, rows)))
    scenarios = list(dict.fromkeys(map(_scenario, rows)))
    if len(policies) < _LEAST_POLICIES or not {*policies} <= {*_KNOWN_POLICIES}:
        return None
    policies.sort(key=_KNOWN_POLICIES.index)
    figure, (one,) = sheet(
        1,
        "How old data are, by whom the UAV seeks",
        experiment.title,
        high=0.9 + 0.14 * len(scenarios) * (len(policies) + 1),
    )
    for place, policy in enumerate(policies):
        own = [row for row in rows if _policy(row) == policy]
        height = np.array([-scenarios.index(_scenario(row)) for row in own], dtype=np.float64)
        height -= 0.8 * ((place + 0.5) / len(policies) - 0.5)
        found = [interval(runs.values(row, measure, runs.numbers(row))) for row in own]
        value, low, high = np.array(found).T
        kind = _KNOWN_POLICIES.index(policy)
        style: dict[str, Any] = {"color": COLOURS[kind], "marker": _MARKERS[kind]}
        one.hlines(height, low, high, colors=COLOURS[kind], lw=1.6)
        one.scatter(value, height, s=22, zorder=3, label=policy, **style)
    one.set_yticks(-np.arange(len(scenarios)), scenarios, fontsize=8)
    one.set(
        xlabel=f"{_AGES[measure]}, 95 % intervals",
        ylim=(-len(scenarios) + 0.45, 0.55),
        xlim=(0, None),
    )
    one.tick_params(axis="y", length=0, labelcolor=INK, color=FAINT)
    legend_below(figure)
    return figure


def _policy(row: Row) -> str:
    return settings_text({"policy": value_of(row.settings, "policy")}, ["policy"])


def _scenario(row: Row) -> str:
    """A row's label without its policy."""
    parts = [FLOWN_IN.get(p, p) for p in row.label.split(", ") if p != _policy(row)]
    return ", ".join(parts) or "all"


def draw_fidelity(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """Missions by experiments as a factor of what flies, with the tenth that is allowed."""
    other, found = flown_beside(Runs(experiment, records))
    if not found:
        return None
    figure, (one,) = sheet(
        1,
        f"The same missions by experiments and by {other}",
        "Ratios of geometric means with 95 % intervals; grey: within 10 %",
        high=0.9 + 0.2 * len(found),
    )
    height = -np.arange(len(found))
    value, low, high = np.array([each.ratio for each in found]).T
    one.axvspan(1 - WITHIN, 1 + WITHIN, color=FAINT, alpha=0.18, lw=0)
    one.axvline(1.0, color=FAINT, lw=0.8)
    one.hlines(height, low, high, colors=COLOURS[0], lw=1.6)
    one.scatter(value, height, color=COLOURS[0], s=25, zorder=3)
    one.set_yticks(height, [each.name for each in found], fontsize=8)
    one.set(xlabel=f"experiments / {other}")
    one.tick_params(axis="y", length=0, labelcolor=INK, color=FAINT)
    return figure


def draw_comparison(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """Every row's goals, times, ages and waits, one dot each."""
    found = lines(experiment, records)
    if not 1 < len(found) <= _MOST_ROWS or "goals_total" not in records[0]["measures"]:
        return None
    groups = [settings_text(line.settings, experiment.varied[:1]) for line in found]
    order = list(dict.fromkeys(groups))
    colours = [COLOURS[order.index(group) % len(COLOURS)] for group in groups]
    figure, axes = sheet(
        len(_COMPARED),
        "The rows compared",
        f"{experiment.title}; means with 95 % confidence intervals",
        high=0.9 + 0.19 * len(found),
    )
    height = np.arange(len(found))[::-1]
    for one, (measure, label) in zip(axes, _COMPARED, strict=True):
        value, low, high = np.array([line.values[measure] for line in found]).T
        one.hlines(height, low, high, colors=colours, lw=1.6)
        one.scatter(value, height, color=colours, s=25, zorder=3)
        one.set_yticks(height, [line.label for line in found], fontsize=7.5)
        one.set(xlabel=label, ylim=(-0.7, len(found) - 0.3))
        one.margins(x=0.08)
        one.tick_params(axis="y", length=0, labelcolor=INK, color=FAINT)
    return figure


def draw_outcome(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """What every policy is worth over scenarios, as differences from the first row."""
    found = Scenarios(experiment, records)
    if not is_of_scenarios(experiment) or len(found.numbers) < _LEAST_SCENARIOS:
        return None
    shown = [OUTCOMES[0], *OUTCOMES[2:]]
    count = counted(len(found.numbers), "scenarios")
    figure, axes = sheet(
        len(shown),
        f"Seek policies compared with '{found.base.label}'",
        f"{count}, each met by every policy; means with 95 % confidence intervals over scenarios",
        high=0.9 + 0.19 * len(found.rows),
        columns=2,
    )
    height = np.arange(len(found.rows))[::-1]
    for one, outcome in zip(axes, shown, strict=True):
        apart = [found.effect(row, outcome).interval() for row in found.rows[1:]]
        value, low, high = np.array([(0.0, 0.0, 0.0), *apart]).T
        if outcome.factor:
            value, low, high = np.exp(value), np.exp(low), np.exp(high)
            one.set_xscale("log")
            one.set_xlim(_LEAST_FACTOR, max(1 / _LEAST_FACTOR, 1.1 * float(np.nanmax(high))))
            _label_log(one.xaxis)
            for place in np.flatnonzero(value < _LEAST_FACTOR):
                beyond = f"◂ {value[place]:.2g}"
                one.text(_LEAST_FACTOR * 1.02, height[place], beyond, va="center", fontsize=7.5)
        one.axvline(1.0 if outcome.factor else 0.0, color=FAINT, lw=0.8)
        one.hlines(height, low, high, colors=COLOURS[0], lw=1.6)
        one.scatter(value, height, color=COLOURS[0], s=25, zorder=3)
        one.set_yticks(height, [row.label for row in found.rows], fontsize=7.5)
        unit = "times" if outcome.factor else "points"
        one.set(xlabel=f"{outcome.head} ({unit})", ylim=(-0.7, len(found.rows) - 0.3))
        one.tick_params(axis="y", length=0, labelcolor=INK, color=FAINT)
    return figure


def draw_links(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """How well models of links predict: calibration, and the Brier score of every run."""
    runs = of_links(experiment, records)
    if not runs or not all(run["curves"] for run in runs):
        return None
    figure, axes = sheet(
        2,
        "Links predicted by the UAV's map, by path loss and by distance",
        f"{counted(len(runs), 'runs')}, links that no model had seen",
        high=3.4,
        one_scale="none",
    )
    curves, scores = axes
    curves.plot([0, 1], [0, 1], color=FAINT, lw=0.8)
    for (name, label), colour in zip(MODELS_SHOWN.items(), COLOURS, strict=False):
        expected, seen = calibration(runs, name)
        curves.plot(expected, seen, color=colour, marker="o", ms=3.5, lw=1.4, label=label)
        values = np.sort([run["measures"][f"brier_{name.replace(' ', '_')}"] for run in runs])
        share = (np.arange(len(values)) + 1) / len(values)
        scores.step([0.0, *values], [0.0, *share], where="post", color=colour, lw=1.6, label=label)
    curves.set(xlabel="predicted probability", ylabel="share that was there", ylim=(0, 1))
    scores.set(xlabel="Brier score of a run", ylabel="share of runs", xlim=(0, None), ylim=(0, 1))
    legend_below(figure)
    return figure


def draw_cost(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """Processor time for each robot and simulated second over the size of the team.

    Only where rows differ in the number of ground robots; a line for each of their other settings.
    """
    others = [key for key in experiment.varied if key != "ugvs"]
    runs = _runs_by_row(experiment, records)
    costs: dict[str, dict[int, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row, own in runs.items():
        robots = value_of(row.settings, "ugvs") + value_of(row.settings, "uavs")
        simulated_s = value_of(row.settings, "duration_s")
        costs[settings_text(row.settings, others)][robots] += [
            1e3 * run["measures"]["cpu_s"] / robots / simulated_s for run in own
        ]
    if len({robots for sizes in costs.values() for robots in sizes}) < _LEAST_SIZES:
        return None
    note = f"{experiment.title}; each run a dot, lines through their means"
    figure, (one,) = sheet(1, "What a robot costs", note, high=3.6)
    for (label, sizes), colour, dash in zip(
        sorted(costs.items()), cycle(COLOURS), cycle(DASHES), strict=False
    ):
        robots, means_ms = zip(*sorted((n, np.mean(own)) for n, own in sizes.items()), strict=True)
        one.plot(robots, means_ms, color=colour, ls=dash, lw=1.6, label=label or "all rows")
        for n, costs_ms in sizes.items():
            one.scatter([n] * len(costs_ms), costs_ms, color=colour, s=14, zorder=3)
    one.set(xlabel="robots", ylabel="processor time per robot and simulated second (ms)")
    one.set(xscale="log", yscale="log")
    _label_log(one.xaxis)
    _label_log(one.yaxis)
    one.legend(fontsize=7.5, labelcolor=INK, handlelength=2.4)
    return figure


def draw_goals(experiment: Experiment, records: Sequence[Record]) -> Figure:
    """Goals over time: a line for each row, in panels by the first settings."""
    runs = _runs_by_row(experiment, records)
    inner, outer = list(experiment.varied), list[str]()

    def panels() -> dict[str, list[Row]]:
        found: dict[str, list[Row]] = {}
        for row in runs:
            found.setdefault(settings_text(row.settings, outer), []).append(row)
        return found

    while inner[:-1] and max(map(len, panels().values())) > _MOST_LINES:
        outer.append(inner.pop(0))
    note = f"{experiment.title}; mean of the runs of each team, band: one standard error"
    figure, axes = sheet(len(panels()), "Goals reached over time", note)
    for one, (shared, own) in zip(axes, panels().items(), strict=True):
        for row, colour, dash in zip(own, cycle(COLOURS), cycle(DASHES), strict=False):
            label = settings_text(row.settings, inner) or row.label
            _plot_goals(one, runs[row], {"color": colour, "ls": dash, "label": label})
        one.set(xlabel="time (min)", ylabel="goals reached (%)", ylim=(0, 100))
        one.set_title(shared or experiment.title, loc="left")
        one.legend(fontsize=7.5, labelcolor=INK, handlelength=2.4)
    return figure


def _plot_goals(one: Axes, runs: Sequence[Record], style: dict[str, Any]) -> None:
    longest_s = max(value_of(run["settings"], "duration_s") for run in runs)
    times_s = np.arange(0, longest_s + _STEP_S, _STEP_S)
    curves = np.array([_reached(run, times_s) for run in runs])
    mean = curves.mean(axis=0)
    one.plot(times_s / 60, mean, lw=1.7, **style)
    if len(curves) > 1:
        error = curves.std(axis=0, ddof=1) / np.sqrt(len(curves))
        band = {"color": style["color"], "alpha": 0.13, "linewidth": 0}
        one.fill_between(times_s / 60, mean - error, mean + error, **band)
    one.set_xlim(0, float(times_s[-1]) / 60)


def _reached(run: Record, times_s: Numbers) -> Numbers:
    total = run["measures"]["goals_total"] or 1
    found = np.sort([visit[1] for visit in run["curves"]["goals"]])
    share: Numbers = 100 * np.searchsorted(found, times_s, side="right") / total
    return share


def draw_bandwidth(experiment: Experiment, records: Sequence[Record]) -> Figure:
    """Bandwidth over time of the first runs of a few rows, as the paper's figure of the field."""
    runs = _runs_by_row(experiment, records)
    rows = list(runs)
    if len(rows) > _MOST_EXAMPLES:  # spread over the experiment
        rows = [rows[n] for n in np.linspace(0, len(rows) - 1, _MOST_EXAMPLES).round().astype(int)]
    note = f"{experiment.title}; the first run of some teams, in bins of {BIN_S:.0f} s"
    figure, axes = sheet(len(rows), "Bandwidth over time, all robots together", note)
    for one, row in zip(axes, rows, strict=True):
        _plot_bandwidth(one, runs[row][0])
        one.set_title(row.label, loc="left")
    return figure


def _plot_bandwidth(one: Axes, run: Record) -> None:
    rate = np.array(run["curves"]["bin_bytes"], dtype=np.float64) / BIN_S / 1e3
    times_min = (np.arange(len(rate)) + 0.5) * BIN_S / 60
    one.bar(times_min, rate, width=BIN_S / 60, color=COLOURS[0], linewidth=0)
    silent = 100 * float(np.mean(rate == 0)) if len(rate) else 0.0
    caption = f"mean {rate.mean():.1f} kB/s, silent {silent:.0f} % of the time"
    style: dict[str, Any] = {"ha": "right", "va": "bottom", "color": FAINT, "fontsize": 8}
    one.text(0.995, 1.02, caption, transform=one.transAxes, **style)
    one.set(xlabel="time (min)", ylabel="kB/s", xlim=(0, len(rate) * BIN_S / 60))


def _runs_by_row(experiment: Experiment, records: Sequence[Record]) -> dict[Row, list[Record]]:
    """The rows that have runs, with these."""
    runs = {row: [r for r in records if r["row"] == row.label] for row in experiment.rows}
    return {row: own for row, own in runs.items() if own}


_Draw = Callable[[Experiment, Sequence[Record]], Figure | None]
_OF_MEASURES: Final[Mapping[str, _Draw]] = {
    "table": draw_table,
    "readings": draw_readings,
    "policies": draw_policies,
    "fidelity": draw_fidelity,
    "compare": draw_comparison,
    "cost": draw_cost,
    "outcome": draw_outcome,
}
_OF_CURVES: Final[Mapping[str, _Draw]] = {
    "links": draw_links,
    "goals": draw_goals,
    "bandwidth": draw_bandwidth,
}
"""Figures in the order in which to look at them; archives have no curves."""


def draw_all(experiment: Experiment, records: Sequence[Record], folder: Path) -> list[Path]:
    """Draw every figure that runs have the numbers for into DIR/figures, as PNG and PDF.

    Returns the PNG files, in the order in which to look at them.

    Raises:
        PictureError: a file cannot be written.
    """
    into = folder / "figures"
    into.mkdir(exist_ok=True)
    drawn = []
    known = {**_OF_MEASURES, **(_OF_CURVES if any(r["curves"] for r in records) else {})}
    for name, draw in known.items():
        path = into / f"{name}.png"
        with mpl.rc_context(fname=_STYLE):
            figure = draw(experiment, records)
            if figure is not None:
                save(figure, path, path.with_suffix(".pdf"))
                drawn.append(path)
    return drawn
