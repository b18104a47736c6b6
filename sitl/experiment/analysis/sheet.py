"""What the figures share: colours that colour-blind readers can tell apart, panels, style.

The colours are those of M. Okabe and K. Ito; lines differ in their dashes too, so the figures can
be read in black and white.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Final, Literal

from air_router.errors import PictureError
from mocha_link.errors import needs_extra

with needs_extra("a figure", "experiments", "air-router"):
    import matplotlib as mpl
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

INK, FAINT = "#30363d", "#7b838b"
COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
DASHES: Final[tuple[Any, ...]] = ("-", (0, (4, 1.6)), (0, (1, 1.2)), (0, (5, 1.5, 1, 1.5)))
_DPI: Final = 140

_STYLE: Final = Path(__file__).with_name("figures.mplstyle")


def styled() -> AbstractContextManager[None]:
    """Everything that is drawn within looks alike."""
    return mpl.rc_context(fname=_STYLE)


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
            figure.savefig(path, dpi=_DPI, facecolor="white")
        except (OSError, ValueError) as error:
            raise PictureError(f"cannot write the figure {path}: {error}") from None
