"""The page of usual values, docs/evidence/usual-values.md, as the code's table makes it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from air_router.files.usual_values import MISSION, OPTIONS, WORLD, Band, OtherUnit

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "usual-values.md"
HEAD = """\
# Usual values

`air-router check` notes a number that is legal but unusual, and names the unit it was probably
given in: `altitude_m: 400` may be 122 m in feet. The edit page, the pre-flight card and commands
with the same kind of option do the same. A note ([`unusual-value`](../errors.md#problems-in-files))
stops nothing:

    'duration_s' is 25 s; usual is 60 to 14400 s (a multicopter flies for minutes to a \
few hours); given in minutes? then write 1500

`[]` stands for every entry of a list, `*` for every name. *lower* and *higher* name the units that
explain a value below or above the usual range. The tables are printed from the code
(`DOCS_WRITE=1 pytest tests/docs`).
"""
AS_IN_MISSIONS = (
    "`--altitude`, `--clearance`, `--duration` and `--speed` (of `cover`) have a mission's ranges."
)
COLUMNS = "| number | usual | lower: given in | higher: given in | why |\n|---|---|---|---|---|"
PARTS = (
    ("Mission files", "", MISSION),
    ("World files", "", WORLD),
    (
        "Options",
        AS_IN_MISSIONS,
        OPTIONS,
    ),
)


def page() -> str:
    return "\n".join([HEAD, *(line for part in PARTS for line in _part(*part))])


def _part(title: str, text: str, bands: Iterable[Band]) -> Iterator[str]:
    yield f"## {title}\n"
    if text:
        yield f"{text}\n"
    yield COLUMNS
    for band in bands:
        name = f"--{band.field}" if bands is OPTIONS else band.field
        usual = f"{band.low:g} to {band.high:g}{band.unit}"
        yield f"| `{name}` | {usual} | {_units(band.below)} | {_units(band.above)} | {band.why} |"
    yield ""


def _units(units: Iterable[OtherUnit]) -> str:
    return ", ".join(unit.name for unit in units)
