"""The figure of links that can be told beforehand. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from sitl.experiment.campaign.links import (
    BUILDINGS_M,
    DISTANCES_M,
    comparison,
    counts_of,
    fitted,
    halves,
    predicted,
)
from sitl.experiment.campaign.plan import Experiment, Record
from sitl.experiment.figures.figure_sheet import COLOURS, DASHES, INK, sheet

_SHOWN = (0, 3, 5, 7)


def draw_links(experiment: Experiment, records: Sequence[Record]) -> Figure | None:
    """How often robots on the ground were in contact, by distance and by what stood between."""
    own = [record for record in records if "links" in record["curves"]]
    learn, test = halves(own)
    if not learn or not test:
        return None
    figure, axes = sheet(
        2,
        "Which links the map foretells",
        f"{experiment.title}; dots: runs that were not learned from, lines: the prediction",
        high=3.3,
    )
    counts = counts_of(test)
    middle_m = (DISTANCES_M[:-1] + DISTANCES_M[1:]) / 2
    chances = {
        flag: predicted(fitted(counts_of(learn), buildings=flag), buildings=flag)
        for flag in (False, True)
    }
    for one, flag, title in (
        (axes[0], False, "from the distance alone"),
        (axes[1], True, "from the distance and the map"),
    ):
        for place, index in enumerate(_SHOWN):
            cases, linked = counts[:, index, 0], counts[:, index, 1]
            enough = cases >= 20
            colour = COLOURS[place]
            one.plot(
                middle_m[enough],
                100 * linked[enough] / cases[enough],
                "o",
                ms=3.5,
                color=colour,
                mew=0,
            )
            line = chances[flag][:, index]
            label = _words(index) if flag else None
            one.plot(
                middle_m,
                100 * line,
                color=colour if flag else INK,
                lw=1.5,
                ls=DASHES[place] if flag else "-",
                label=label,
            )
        found = comparison(own)["distance and map" if flag else "distance"]
        one.set_title(title, loc="left")
        one.text(
            0.98,
            0.96,
            f"Brier {found.brier:.4f}, AUC {found.area:.3f}",
            transform=one.transAxes,
            ha="right",
            va="top",
            fontsize=8,
        )
        one.set_xlabel("distance (m)")
        one.set_ylabel("in contact (%)")
        one.set_ylim(-2, 102)
        one.set_xlim(0, float(np.max(middle_m[counts[..., 1].sum(axis=1) > 0], initial=40)) * 1.3)
    axes[1].legend(title="between them", fontsize=7.5, loc="center right", labelcolor=INK)
    return figure


def _words(index: int) -> str:
    low, high = BUILDINGS_M[index : index + 2]
    return "no building" if index == 0 else f"{low:g} to {high:g} m of building"
