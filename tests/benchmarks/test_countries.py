"""The harness that compares countries reads for itself, and notices what differs."""

import json
import math
from pathlib import Path

import pytest

from benchmarks.countries.compare import main
from benchmarks.countries.independent import area_m2, limit, read

DATA = Path(__file__).parents[1] / "data"
BOX = [[8, 47], [8.01, 47], [8.01, 47.01], [8, 47.01], [8, 47]]


def test_our_samples_are_read_the_same_by_both(tmp_path, capsys):
    for name in ("countries/openair_edr4_false_selfcross.txt", "files/airspace.txt",
                 "countries/nested_uaszone_limits.geojson", "files/geozones_ed269.json",
                 "files/geozones_ed318.json"):  # fmt: skip
        (tmp_path / Path(name).name).write_bytes((DATA / name).read_bytes())
    assert main([str(tmp_path), "--missions", "3", "--json", str(tmp_path.parent / "rows")]) == 0
    rows = json.loads((tmp_path.parent / "rows").read_text())
    assert len(rows) == 5
    assert all(row["missions"] and row["compared"] for row in rows)
    assert "0 refused for the file's sake" in capsys.readouterr().out


def test_an_airspace_that_is_not_understood_is_a_refusal_and_missing(tmp_path, capsys):
    text = (DATA / "files" / "airspace.txt").read_text("utf-8")
    (tmp_path / "a.txt").write_text(text + "\nDY 47N 8E\n", "utf-8")
    assert main([str(tmp_path), "--why"]) == 1
    out = capsys.readouterr().out
    assert "only in one reading" in out
    assert "'DY' is not read" in out


def test_areas_of_the_independent_reading(tmp_path):
    path = tmp_path / "z.json"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [
        {"properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
        for ring in (BOX, [BOX[0], BOX[2], BOX[1], BOX[3]])]}))  # fmt: skip
    box, bow = read(path).values()
    exact_m2 = 0.01**2 * 111_188 * 111_320 * math.cos(math.radians(47.005))
    assert area_m2(box) == (pytest.approx(exact_m2, rel=2e-3), False)
    assert area_m2(bow) == (pytest.approx(exact_m2 / 2, rel=2e-3), True)


@pytest.mark.parametrize(
    ("text", "lower", "upper"),
    [
        ("5000MSL", (1524, "sea"), (1524, "sea")),
        ("1000 FT AGL", (304.8, "ground"), (304.8, "ground")),
        ("FL 95", (9500 * 0.3048 * 0.9 - 600, "sea"), None),
        ("GND", None, None),
        ("1000 FT ALT \u00b7", (304.8, "sea"), (304.8, "sea")),
        ("ask", None, None),
    ],
)
def test_limits_of_the_independent_reading(text, lower, upper):
    for wanted, is_upper in ((lower, False), (upper, True)):
        found = limit(text, upper=is_upper)
        assert found == (wanted and (pytest.approx(wanted[0]), wanted[1]))
