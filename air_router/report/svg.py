"""Drawing as SVG, in two widths: for a screen and for a phone. No script, no fonts.

The colours are those of the map pages, which pictures and reports share: one style sheet has them.
Pictures share with reports, too, where words stand and how numbers are written.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from html import escape
from importlib import resources
from typing import Final, NamedTuple

Series = Sequence[tuple[float, float]]

WIDE, NARROW = 960, 400
LEFT, RIGHT, TOP, BOTTOM = 54, 14, 10, 26
_TIME_STEPS_S: Final = (5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14_400, 43_200)


def element(
    tag: str, css: str = "", title: str = "", words: str = "", **attributes: float | str
) -> str:
    """An SVG element with `words` in it; `title` is shown where the pointer is.

    Numbers are pixels. An attribute that is "" is left out; ``_`` in its name stands for ``-``.
    """
    given = {"class": css, **attributes}
    told = "".join(
        f' {name.replace("_", "-")}="{f"{value:.1f}" if isinstance(value, float) else value}"'
        for name, value in given.items()
        if value != ""
    )
    inner = f"<title>{escape(title)}</title>" if title else ""
    return f"<{tag}{told}>{inner}{escape(words)}</{tag}>"


def text(x: float, y: float, words: str, anchor: str = "", css: str = "") -> str:
    """Words at a place in pixels."""
    return element("text", css, "", words, x=x, y=y, text_anchor=anchor)


def picture(width: float, height: float, label: str, parts: Iterable[str]) -> str:
    """An SVG of parts, in pixels; `label` says what it shows to those who do not see it."""
    which = "wide" if width > NARROW else "narrow"
    return (
        f'<svg class="{which}" viewBox="0 0 {width:g} {height:g}" role="img" '
        f'aria-label="{escape(label)}">{"".join(parts)}</svg>'
    )


def in_both_widths(draw: Callable[[int], str]) -> str:
    """A picture for a screen, and one for a phone; the style sheet shows one of them."""
    return draw(WIDE) + draw(NARROW)


@dataclass(slots=True)
class Plot:
    """A frame with time to the right and one quantity upwards; `svg` is the picture.

    Args:
        width, height: In pixels of the picture.
        from_s, to_s: The time that it shows; told as hours, minutes and seconds since `from_s`.
        top: The largest value; `bottom`: the least.
    """

    width: int
    height: int
    from_s: float
    to_s: float
    top: float = 1.0
    bottom: float = 0.0
    _parts: list[str] = field(default_factory=list)  # SVG elements in order

    def x(self, t: float) -> float:
        """Where a time is; one before or after lies on the border."""
        span_s = max(self.to_s - self.from_s, 1e-9)
        share = min(max((t - self.from_s) / span_s, 0.0), 1.0)
        return LEFT + share * (self.width - LEFT - RIGHT)

    def y(self, value: float) -> float:
        """Where a value is; what is beyond the frame lies on its border."""
        share = (value - self.bottom) / max(self.top - self.bottom, 1e-9)
        return self.height - BOTTOM - min(max(share, 0.0), 1.0) * (self.height - TOP - BOTTOM)

    def across(self, y: float, css: str) -> None:
        """A line from the left to the right, at a place in pixels."""
        self._parts.append(element("path", css, d=f"M{LEFT} {y:.1f}H{self.width - RIGHT}"))

    def axes(self, ticks: Iterable[float] | None = None) -> None:
        """The time, and lines with their values, without a sign; `ticks` None: at round values."""
        for value in ticks if ticks is not None else nice(self.bottom, self.top):
            self.across(self.y(value), "grid")
            self.text(LEFT - 6, self.y(value) + 4, number(abs(value)), "end")
        self.times()

    def times(self) -> None:
        """The time below."""
        most = 12 if self.width > NARROW else 5
        span_s = self.to_s - self.from_s
        longest_s = 86_400 * math.ceil(span_s / most / 86_400)
        step_s = next((s for s in _TIME_STEPS_S if span_s / s <= most), longest_s)
        for t in range(0, math.floor(span_s) + 1, step_s):
            x = self.x(self.from_s + t)
            self._parts.append(element("path", "tick", d=f"M{x:.1f} {self.height - BOTTOM}v4"))
            self.text(x, self.height - 8.0, clock(t), "middle")
        self.across(self.height - BOTTOM, "axis")

    def line(self, series: Series, css: str, title: str = "", *, steps: bool = False) -> None:
        """A line through points, or one that stays until the next."""
        places = [(self.x(t), self.y(v)) for t, v in thinned(series, self.width // 2)]
        if not places:
            return
        path = [f"M{places[0][0]:.1f} {places[0][1]:.1f}"]
        for x, y in places[1:]:
            path.append(f"H{x:.1f}V{y:.1f}" if steps else f"L{x:.1f} {y:.1f}")
        self._parts.append(element("path", f"line {css}", title, d="".join(path)))

    def bar(
        self, from_s: float, to_s: float, place: tuple[float, float], css: str, title: str
    ) -> None:
        """A block from one time to another; `place`: its top and height in pixels."""
        x, (y, height) = self.x(from_s), place
        width = max(self.x(to_s) - x, 1.0)
        self._parts.append(element("rect", css, title, x=x, y=y, width=width, height=height))

    def level(self, value: float, words: str) -> None:
        """A limit: a line across, with words."""
        self.across(self.y(value), "level limit")
        self.text(self.width - RIGHT - 4.0, self.y(value) - 5, words, "end", "name")

    def text(self, x: float, y: float, words: str, anchor: str, css: str = "") -> None:
        """Words at a place in pixels; none if they are ""."""
        if words:
            self._parts.append(text(x, y, words, anchor, css))

    def svg(self, label: str) -> str:
        """The picture; `label` says what it shows to those who do not see it."""
        return picture(self.width, self.height, label, self._parts)


def thinned(series: Series, most: int) -> Series:
    """Fewer points where there are more than `2 * most`: four at most of each of `most` spans.

    The least and the largest of each, and its first and last.
    """
    if len(series) <= 2 * most:
        return series
    size = math.ceil(len(series) / most)
    return [
        point
        for first in range(0, len(series), size)
        for point in _extremes(series[first : first + size])
    ]


def _extremes(part: Series) -> Iterator[tuple[float, float]]:
    least = min(range(len(part)), key=lambda i: part[i][1])
    most = max(range(len(part)), key=lambda i: part[i][1])
    yield from (part[i] for i in sorted({0, least, most, len(part) - 1}))


def nice(low: float, high: float) -> list[float]:
    """Round numbers between two values, five steps at most; `low` alone where there is nothing."""
    span = high - low
    if not 0 < span < math.inf:
        return [low]
    step = 10.0 ** math.floor(math.log10(span / 5))
    step *= next(factor for factor in (1, 2, 5, 10) if span / (step * factor) <= 5)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [i * step for i in range(first, last + 1)]


def number(value: float) -> str:
    """A short number: 12000 is 12k, 2500000 is 2.5M."""
    if abs(value) >= 1e6:
        return f"{value / 1e6:.3g}M"
    if abs(value) >= 1e4:
        return f"{value / 1e3:.3g}k"
    return f"{round(value, 6):g}"


def clock(seconds: float) -> str:
    """Minutes and seconds, with hours when there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


# Colours


_COLOUR = re.compile(r"--([\w-]+):\s*(#\w+);")
_LIGHT, _DARK = ":root {", ':root[data-theme="dark"] {'


@cache
def colours(*, dark: bool = False) -> dict[str, str]:
    """Each colour by its name, such as "fence", as the light or the dark pages have it."""
    sheet = resources.files("air_router.web").joinpath("page", "theme.css").read_text("utf-8")
    block = sheet.partition(_DARK if dark else _LIGHT)[2].partition("}")[0]
    return dict(_COLOUR.findall(block))


def style_sheet() -> str:
    """All of them as CSS, light or dark as the system says."""
    light, dark = (
        " ".join(f"--{name}: {colour};" for name, colour in colours(dark=is_dark).items())
        for is_dark in (False, True)
    )
    return (
        f":root {{ color-scheme: light dark; {light} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
    )


# Where words stand on a picture: beside what they name, on no other words and marks.


class _Box(NamedTuple):
    """What is covered, and by which words; "" is a mark."""

    west: float
    east: float
    south: float
    north: float
    words: str

    def shared(self, other: _Box) -> float:
        """The area that both cover."""
        width = min(self.east, other.east) - max(self.west, other.west)
        height = min(self.north, other.north) - max(self.south, other.south)
        return max(width, 0.0) * max(height, 0.0)


class Labels:
    """Words and marks of a picture, in any unit, as long as it is one."""

    def __init__(self) -> None:
        self._taken: list[_Box] = []  # what is covered

    def mark(self, x: float, y: float, radius: float) -> None:
        """Words that are placed later go out of this mark's way."""
        self._taken.append(_Box(x - radius, x + radius, y - radius, y + radius, ""))

    def place(
        self,
        words: str,
        at: tuple[float, float],
        size: tuple[float, float],
        offs: Sequence[tuple[float, float]],
    ) -> tuple[float, float] | None:
        """Take the first of some places that is free, else the one that covers least.

        Args:
            words: What is written.
            at: What they name.
            size: Their width and height.
            offs: How far from there their middle may be, the best first.

        Returns:
            One of `offs`; None where the same words stand at the first: they name this, too.
        """
        boxes = []
        for dx, dy in offs:
            (x, y), (width, height) = (at[0] + dx, at[1] + dy), size
            boxes.append(_Box(x - width / 2, x + width / 2, y - height / 2, y + height / 2, words))
        if any(boxes[0].shared(other) for other in self._taken if other.words == words):
            return None
        covered = [sum(map(box.shared, self._taken)) for box in boxes]
        best = covered.index(min(covered))
        self._taken.append(boxes[best])
        return offs[best]
