"""The style of figures in files and pages: colors, plain axes, real text.

The colors are those of the map pages. A figure is drawn in the light colors; in a page each becomes
the page's variable, so it follows light and dark mode. Needs matplotlib.
"""

import io
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import resources
from typing import Any, Final

from mocha_link.errors import needs_extra
from mocha_link.sanitize import sanitize

with needs_extra("a picture", "plot", "air-router"):
    import matplotlib as mpl
    from matplotlib.figure import Figure
    from matplotlib.text import Text

PX: Final = 1 / 72
"""Inches per pixel, the unit of our SVG."""

NAME: Final = "name"
"""Prefix of the gid of a text on a map, which becomes its class in the style sheet."""

_COLOUR: Final = re.compile(r"--([\w-]+):\s*(#\w+);")
_LIGHT, _DARK = ":root {", ':root[data-theme="dark"] {'
_SVG: Final = "{http://www.w3.org/2000/svg}"
_LINK: Final = "{http://www.w3.org/1999/xlink}href"
_FONT: Final = "DejaVu Sans"  # comes with matplotlib: the same figure on every machine


@cache
def colours(*, dark: bool = False) -> dict[str, str]:
    """The colors of the light or dark pages, by name such as "fence"."""
    found: dict[str, str] = {}
    for room, path in (("web", "page/theme.css"), ("report", "templates/figures.css")):
        sheet = resources.files(f"air_router.{room}").joinpath(path).read_text("utf-8")
        found |= _COLOUR.findall(sheet.partition(_DARK if dark else _LIGHT)[2].partition("}")[0])
    return found


class Ink:
    """The colors of a map's parts on white paper."""

    _OF: Final = colours()
    FENCE, ZONE, EDGE, ROUTE = _OF["fence"], _OF["zone"], _OF["graph"], _OF["route"]
    TRACK, WRONG, HOME = _OF["leg"], _OF["wrong"], _OF["good"]
    ROBOT = RALLY = AROUND = _OF["around"]
    ZONE_FILL, ZONE_HATCH, ZONE_NAME = _OF["zone-fill"], _OF["zone-hatch"], _OF["zone-name"]
    GROUND, BEYOND, COVERED, HALO = _OF["ground"], _OF["beyond"], _OF["covered"], _OF["halo"]
    TEXT, FAINT, IDLE = _OF["ink"], _OF["soft"], _OF["graph"]


@contextmanager
def figure_style(name: str = "") -> Iterator[None]:
    """The style while a figure is made and written.

    Args:
        name: Determines the ids in its SVG; must be unique within a page.
    """
    soft = colours()["soft"]
    style: Any = {
        "svg.fonttype": "none",  # text stays text
        "svg.hashsalt": name or "figure",  # the same ids each time
        "text.parse_math": False,  # a name may have a $
        "font.family": [_FONT],
        "font.size": 11.5,
        "text.color": colours()["ink"],
        "axes.facecolor": "none",
        "axes.edgecolor": soft,
        "axes.labelcolor": soft,
        "axes.linewidth": 0.8,
        "axes.axisbelow": True,
        "axes.spines.left": False,
        "axes.spines.right": False,
        "axes.spines.top": False,
        "grid.color": colours()["grid"],
        "xtick.color": soft,
        "ytick.color": soft,
        "ytick.major.size": 0,
        "lines.linewidth": 1.8,
        "lines.solid_joinstyle": "round",
        "path.simplify_threshold": 0.4,  # tolerance in pixels for long lines
        "hatch.linewidth": 0.6,
    }
    with mpl.rc_context(style), warnings.catch_warnings():
        # The viewer has glyphs that our font lacks.
        warnings.filterwarnings("ignore", "Glyph .* missing", UserWarning)
        yield


def keep_letters(figure: Figure) -> None:
    """Remove unprintable characters from all texts of a figure: XML does not allow them."""
    for text in figure.findobj(Text):
        text.set_text(sanitize(text.get_text()))


def embedded(
    figure: Figure, kind: str, label: str, tooltips: Mapping[str, Sequence[str]], **saving: Any
) -> str:
    """A figure as an SVG element for an HTML page, without global ids and styles.

    Args:
        figure: A figure made within `figure_style`, which is still active.
        kind: Its class in the style sheet.
        label: Its accessible description.
        tooltips: The tooltips of each part of the artist with a gid.
        saving: As for `Figure.savefig`.
    """
    keep_letters(figure)
    file = io.BytesIO()
    bare = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(file, format="svg", facecolor="none", metadata=bare, **saving)
    root = ET.fromstring(file.getvalue())  # noqa: S314 - matplotlib's
    for defs in root.findall(f"{_SVG}defs"):
        for style in defs.findall(f"{_SVG}style"):
            defs.remove(style)  # it would apply to the whole page
    for group in root.iter(f"{_SVG}g"):
        gid = group.attrib.pop("id", "")
        if gid.startswith(NAME):
            group.set("class", gid)
        texts = tooltips.get(gid, ())
        drawn = (part for part in group.iter() if part.tag in {f"{_SVG}use", f"{_SVG}path"})
        shapes = [part for part in drawn if "id" not in part.attrib]
        for shape, text in zip(shapes, texts, strict=False):
            ET.SubElement(shape, "title").text = sanitize(text)
    for element in root.iter():
        _shorten(element)
    root.attrib = {
        "class": kind,
        "viewBox": root.attrib["viewBox"],
        "role": "img",
        "aria-label": sanitize(label),
    }
    return _themed(ET.tostring(root, encoding="unicode"))


def _shorten(element: ET.Element) -> None:
    """Shorten the SVG: a tenth of a pixel is invisible."""
    element.tag = element.tag.removeprefix(_SVG)
    if not (element.text or "").strip():
        element.text = None
    element.tail = None
    given = element.attrib
    if _LINK in given:
        given["href"] = given.pop(_LINK)
    for name in {"d", "x", "y"} & given.keys():
        tenths = re.sub(r"-?\d+\.\d+", lambda found: f"{float(found[0]):.1f}", given[name])
        given[name] = " ".join(tenths.split())
    if given.get("transform", "").startswith("rotate(-0 "):
        del given["transform"]
    if "style" in given:
        given["style"] = re.sub(r"font-family: [^;]*;? ?", "", given["style"])


def _themed(svg: str) -> str:
    """Replace each color by the page's variable."""
    names = {colour: name for name, colour in reversed(colours().items())}
    return re.sub(
        r"#[0-9a-f]{6}\b",
        lambda found: f"var(--{names[found[0]]})" if found[0] in names else found[0],
        svg,
    )
