"""The figures of an experiment, drawn from its finished runs. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from sitl.experiment.campaign.plan import Experiment, Record
from sitl.experiment.figures.figure_curves import draw_ages, draw_bandwidth, draw_goals, draw_waits
from sitl.experiment.figures.figure_links import draw_links
from sitl.experiment.figures.figure_places import draw_contacts, draw_places
from sitl.experiment.figures.figure_rows import draw_comparison, draw_table
from sitl.experiment.figures.figure_sheet import save, styled

FOLDER: Final = "figures"


def draw_all(experiment: Experiment, records: Sequence[Record], folder: Path) -> list[Path]:
    """Draw every figure into DIR/figures; the files, in the order in which to look at them.

    Raises:
        PictureError: a file cannot be written.
    """
    into = folder / FOLDER
    into.mkdir(exist_ok=True)
    drawn = []
    for name, draw in (
        ("table", draw_table),
        ("compare", draw_comparison),
        ("goals", draw_goals),
        ("waits", draw_waits),
        ("bandwidth", draw_bandwidth),
        ("places", draw_places),
        ("contacts", draw_contacts),
        ("ages", draw_ages),
        ("links", draw_links),
    ):
        path = into / f"{name}.png"
        with styled():
            figure = draw(experiment, records)
            if figure is not None:
                save(figure, path)
                drawn.append(path)
    return drawn
