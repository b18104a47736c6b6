"""Drawing time series as SVG, in two widths: for a screen and for a phone. No script, no fonts."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Final

Series = Sequence[tuple[float, float]]

WIDE, NARROW = 960, 400
LEFT, RIGHT, TOP, BOTTOM = 54, 14, 10, 26
_TIME_STEPS_S: Final = (5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14_400, 43_200)


@dataclass(slots=True)
class Plot:
    """A frame with time to the right and one quantity upwards; `svg` is the picture.

    Args:
        width, height: In pixels of the picture.
        from_s, to_s: The time that it shows; told as minutes since `from_s`.
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

    def axes(self, ticks: Iterable[float] | None = None) -> None:
        """Lines and numbers."""
        for value in ticks if ticks is not None else nice(self.bottom, self.top):
            y = self.y(value)
            self.add(f'<path class="grid" d="M{LEFT} {y:.1f}H{self.width - RIGHT}"/>')
            self.text(LEFT - 6, y + 4, number(abs(value)), "end")
        self.times()

    def times(self) -> None:
        """The time below."""
        most = 12 if self.width > NARROW else 5
        span_s = self.to_s - self.from_s
        longest_s = 86_400 * math.ceil(span_s / most / 86_400)
        step_s = next((s for s in _TIME_STEPS_S if span_s / s <= most), longest_s)
        t = 0
        while t <= span_s:
            x = self.x(self.from_s + t)
            self.add(
                f'<path class="tick" d="M{x:.1f} {self.height - BOTTOM}v4"/>'
                f'<text x="{x:.1f}" y="{self.height - 8}" text-anchor="middle">{clock(t)}</text>'
            )
            t += step_s
        self.add(f'<path class="axis" d="M{LEFT} {self.height - BOTTOM}H{self.width - RIGHT}"/>')

    def line(self, series: Series, css: str, title: str = "", *, steps: bool = False) -> None:
        """A line through points, or one that stays until the next."""
        places = [(self.x(t), self.y(v)) for t, v in thinned(series, self.width // 2)]
        if not places:
            return
        path = [f"M{places[0][0]:.1f} {places[0][1]:.1f}"]
        for x, y in places[1:]:
            path.append(f"H{x:.1f}V{y:.1f}" if steps else f"L{x:.1f} {y:.1f}")
        self.add(f'<path class="line {css}" d="{"".join(path)}">{_title(title)}</path>')

    def bar(
        self, from_s: float, to_s: float, place: tuple[float, float], css: str, title: str
    ) -> None:
        """A block from one time to another; `place`: its top and height in pixels."""
        x, y = self.x(from_s), place[0]
        width = max(self.x(to_s) - x, 1.0)
        self.add(
            f'<rect class="{css}" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" '
            f'height="{place[1]:.1f}">{_title(title)}</rect>'
        )

    def level(self, value: float, css: str, words: str) -> None:
        """A line across."""
        y = self.y(value)
        self.add(f'<path class="level {css}" d="M{LEFT} {y:.1f}H{self.width - RIGHT}"/>')
        self.text(self.width - RIGHT - 4, y - 5, words, "end", "name")

    def text(self, x: float, y: float, words: str, anchor: str, css: str = "") -> None:
        """Words at a place."""
        if words:
            self.add(
                f'<text class="{css}" x="{x:.1f}" y="{y:.1f}" '
                f'text-anchor="{anchor}">{escape(words)}</text>'
            )

    def add(self, part: str) -> None:
        """Something drawn elsewhere."""
        self._parts.append(part)

    def svg(self, label: str) -> str:
        """The picture; `label` is what it is for those who cannot see it."""
        return picture(self.width, self.height, label, self._parts)


def picture(width: float, height: float, label: str, parts: Iterable[str]) -> str:
    """An SVG of parts."""
    which = "wide" if width > NARROW else "narrow"
    return (
        f'<svg class="{which}" viewBox="0 0 {width:g} {height:g}" role="img" '
        f'aria-label="{escape(label)}">{"".join(parts)}</svg>'
    )


def thinned(series: Series, most: int) -> Series:
    """Fewer points where there are more than pixels: of each span the least and the largest."""
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


def nice(low: float, high: float, most: int = 5) -> list[float]:
    """Round numbers between two values."""
    span = high - low
    if not 0 < span < math.inf:
        return [low]
    step = 10.0 ** math.floor(math.log10(span / most))
    step *= next(factor for factor in (1, 2, 5, 10) if span / (step * factor) <= most)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [i * step for i in range(first, last + 1)]


def number(value: float) -> str:
    """A short number: 1200 is 1.2k."""
    if abs(value) >= 1e6:
        return f"{value / 1e6:.3g}M"
    if abs(value) >= 1e4:
        return f"{value / 1e3:.3g}k"
    return f"{round(value, 6):g}"


def clock(seconds: float) -> str:
    """Minutes and seconds, with hours when there are any."""
    whole = round(seconds)
    minutes, rest = divmod(whole, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def _title(words: str) -> str:
    return f"<title>{escape(words)}</title>" if words else ""
