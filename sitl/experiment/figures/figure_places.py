"""Figures of where robots were and whom they met. Needs matplotlib."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from sitl.experiment.campaign.plan import Experiment, Record
from sitl.experiment.figures.figure_sheet import COLOURS, FAINT, INK, Chart, example_chart
from sitl.experiment.shipped import town_file
from sitl.world.towns.town import Town
from sitl.world.towns.town_file import load_town

_KINDS = {"base": COLOURS[4], "uav": COLOURS[1], "ugv": COLOURS[0]}
_WORDS = {"base": "base station", "uav": "UAV", "ugv": "ground robot"}
_BUILDING, _GREEN, _STREET, _GROUND = "#d5cfc4", "#d3e3cd", "#ffffff", "#efede7"


def draw_places(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """Where robots were in the first runs of some rows, over their town."""
    placed = [record for record in records if "places_m" in record["curves"]]
    if not placed:
        return None
    chart = Chart(
        "Where the robots were",
        "the first run of some teams. Goals: filled where reached",
        "metres east",
        "metres north",
        high=3.4,
    )
    figure = example_chart(chart, partial(_draw_run, experiment), experiment, placed)
    handles: dict[str, Any] = {}
    for one in figure.axes:
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(
        list(handles.values()), list(handles), loc="outside lower center", ncols=5, fontsize=8
    )
    return figure


def _draw_run(experiment: Experiment, one: Axes, runs: Sequence[Record]) -> None:
    town = load_town(town_file(runs[0]["settings"]["town"], Path(experiment.folder)))
    _draw_town(one, town)
    _draw_ways(one, runs[0])
    _draw_goals(one, runs[0])
    one.set_aspect("equal")
    one.grid(visible=False)
    one.set_xlim(town.bounds.west_m, town.bounds.east_m)
    one.set_ylim(town.bounds.south_m, town.bounds.north_m)


def _draw_town(one: Axes, town: Town) -> None:
    one.set_facecolor(_GROUND)
    for road in town.roads:
        one.plot(
            *zip(*road.points, strict=True), color=_STREET, lw=3.2, zorder=1, solid_capstyle="round"
        )
    for rings, colour in ((town.vegetation, _GREEN), (town.buildings, _BUILDING)):
        for ring in rings:
            one.add_patch(Polygon(ring, facecolor=colour, edgecolor="none", zorder=2))


def _draw_ways(one: Axes, run: Record) -> None:
    places_m = np.array(run["curves"]["places_m"], dtype=np.float64)
    told: set[str] = set()
    for index, kind in enumerate(run["curves"]["kinds"]):
        way = places_m[:, index]
        label = "_" if kind in told else _WORDS[kind]
        told.add(kind)
        if kind == "base":
            one.plot(*way[0], "^", color=_KINDS[kind], ms=7, mec="white", zorder=6, label=label)
            continue
        thin = {"uav": 0.7, "ugv": 1.1}[kind]
        one.plot(
            way[:, 0], way[:, 1], color=_KINDS[kind], lw=thin, alpha=0.75, zorder=4, label=label
        )
        one.plot(*way[-1], "o", color=_KINDS[kind], ms=3.5, mec="white", mew=0.5, zorder=5)


def _draw_goals(one: Axes, run: Record) -> None:
    reached = {visit[0] for visit in run["curves"]["goals"]}
    for found, colour, label in (
        (True, COLOURS[2], "goal, reached"),
        (False, "white", "goal, not reached"),
    ):
        goals = run["curves"].get("goal_places_m", [])  # none in runs of before
        places = [place for goal, *place in goals if (goal in reached) is found]
        if places:
            style: dict[str, Any] = {"marker": "s", "s": 26, "edgecolor": INK, "linewidth": 0.8}
            one.scatter(*zip(*places, strict=True), color=colour, zorder=7, label=label, **style)


def plot_contacts(one: Axes, runs: Sequence[Record]) -> None:
    """Who met whom for how long: the mean of the runs of a row."""
    names, kinds = runs[0]["curves"]["robots"], runs[0]["curves"]["kinds"]
    places = _around(kinds)
    total: dict[tuple[int, int], float] = {}
    for run in runs:
        for a, b, _, time_s in run["curves"]["contacts"]:
            total[int(a), int(b)] = total.get((int(a), int(b)), 0.0) + time_s / len(runs)
    widest = max(total.values(), default=1.0) or 1.0
    pairs = sorted(total, key=lambda pair: total[pair])
    air = [any(kinds[i] == "uav" for i in pair) for pair in pairs]
    one.add_collection(
        LineCollection(
            [[places[a], places[b]] for a, b in pairs],
            linewidths=[0.15 + 5.5 * total[pair] / widest for pair in pairs],
            colors=[_KINDS["uav"] if up else _KINDS["ugv"] for up in air],
            alpha=0.55,
            zorder=1,
        )
    )
    style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 6.5, "zorder": 4}
    for name, kind, place in zip(names, kinds, places, strict=True):
        size = 19 if kind == "base" else 15
        one.plot(*place, "o", ms=size, color=_KINDS[kind], mec="white", mew=1.2, zorder=3)
        short = "base" if kind == "base" else name.removeprefix(kind).lstrip("0") or name
        one.text(*place, short, color="white", fontweight="bold", **style)
    said = f"{sum(total.values()) / 60:.0f} min of contact in all; widest {widest / 60:.1f} min"
    one.text(0, -1.42, said, ha="center", fontsize=8, color=FAINT)
    one.set_xlim(-1.7, 1.7)
    one.set_ylim(-1.6, 1.2)
    one.set_aspect("equal")
    one.set_axis_off()


def _around(kinds: Sequence[str]) -> list[tuple[float, float]]:
    """Ground robots on a circle; UAVs and the base station within."""
    ground = [index for index, kind in enumerate(kinds) if kind == "ugv"]
    inner = [index for index, kind in enumerate(kinds) if kind != "ugv"]
    places = {}
    for own, radius, turn in ((ground, 1.0, 0.0), (inner, 0.38 if len(inner) > 1 else 0.0, 0.9)):
        for place, index in enumerate(own):
            angle = turn + 2 * math.pi * place / max(len(own), 1)
            places[index] = (radius * math.sin(angle), radius * math.cos(angle))
    return [places[index] for index in range(len(kinds))]
