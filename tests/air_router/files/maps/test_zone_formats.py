"""Zone formats of other packages: found by their entry point, and harmless when they are broken."""

import json
import os
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[4]
FILES = ROOT / "tests" / "data" / "files"
GROUP = "air_router.zone_formats"
MISSION = """\
home: [47.0, 8.0]
altitude_m: 30
waypoints: [[47.0005, 8.0]]
fence: null
no_fly_zones: []
no_fly_files: [{file}]
"""
SQUARES = """\
from air_router.zone_formats import Geodetic, MapCircle, PlacedSource, ZoneFeature, ZoneFeatures


class SquareFormat:
    name, suffixes = "squares", (".sq",)

    def recognises(self, head):
        return head.startswith(b"SQUARES")

    def read(self, content, path):
        source, features = PlacedSource(path), []
        for number, line in enumerate(content.decode().splitlines()[1:], start=2):
            feature = ZoneFeature(source, f"square {number}", kinds=["toy"])
            features.append(feature)
            try:
                latitude_deg, longitude_deg, radius_m = map(float, line.split())
            except ValueError:
                feature.report((number, 1), "not three numbers; correct it", "wrong-form")
                continue
            circle = MapCircle(Geodetic(latitude_deg, longitude_deg), radius_m)
            feature.add([((number, 1), circle)])
        return ZoneFeatures(features, self.name)


FORMAT = SquareFormat()
"""


def install(folder, module, text, name="acme"):
    """A package of another author: a module, and the metadata that pip would write."""
    (folder / f"{module}.py").write_text(text)
    metadata = folder / f"{name}-1.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text(f"[{GROUP}]\nsquares = {module}:FORMAT\n")


def check(folder, file, text=None):
    """`air-router check` of a mission with this file of zones, where the package is installed."""
    if text is not None:
        (folder / file).write_text(text)
    (folder / "mission.yaml").write_text(MISSION.format(file=file))
    done = subprocess.run(
        [sys.executable, "-m", "air_router", "check", "mission.yaml", "--json"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert "Traceback" not in done.stderr
    return done.returncode, json.loads(done.stdout)


def problems_of(facts):
    return [(each["line"], each["column"], each["code"]) for each in facts["problems"]]


def test_our_formats_are_registered_as_those_of_others_are():
    ours = {entry.name for entry in entry_points(group=GROUP) if entry.dist.name == "air-router"}
    assert ours == {
        "geojson", "gpx", "kml", "kmz", "old_fences", "openair", "waypoint_fences"
    }  # fmt: skip


def test_a_format_of_another_package_is_read(tmp_path):
    install(tmp_path, "acme_squares", SQUARES)
    code, facts = check(tmp_path, "yard.sq", "SQUARES\n47.002 8.0 30\n")
    assert (code, facts["zones"]) == (0, 1)
    code, facts = check(tmp_path, "yard.sq", "SQUARES\n47.0005 8.0 30\n")
    assert code == 3
    assert {each["code"] for each in facts["problems"]} >= {"waypoint-in-zone"}


def test_its_problems_have_their_place(tmp_path):
    install(tmp_path, "acme_squares", SQUARES)
    code, facts = check(tmp_path, "yard.sq", "SQUARES\n47.002 8.0 30\n47.002 x 30\n")
    assert (code, problems_of(facts)) == (3, [(3, 1, "wrong-form")])
    assert facts["problems"][0]["path"].endswith("yard.sq")


def test_it_is_tried_on_content_that_none_of_ours_knows(tmp_path):
    install(tmp_path, "acme_squares", SQUARES)
    code, facts = check(tmp_path, "yard", "SQUARES\n47.002 8.0 30\n")
    assert (code, facts["zones"]) == (0, 1)


BROKEN = {
    "no import": "import no_such_module\n",
    "no format": "FORMAT = 3\n",
    "recognises": SQUARES.replace('return head.startswith(b"SQUARES")', "return 1 / 0"),
    "read": SQUARES.replace("source, features = PlacedSource(path), []", "1 / 0"),
    "lazily": SQUARES.replace("ZoneFeatures(features,", "ZoneFeatures((1 / 0 for _ in features),"),
    "no features": SQUARES.replace("features.append(feature)", "features.append(3)"),
    "nothing": SQUARES.replace("return ZoneFeatures(features, self.name)", "return None"),
    "suffixes": SQUARES.replace('(".sq",)', "3"),
    "exits": "raise SystemExit(3)\n",
}


@pytest.mark.parametrize("text", BROKEN.values(), ids=BROKEN)
def test_a_broken_package_is_named_and_hides_none_of_our_formats(tmp_path, text):
    install(tmp_path, "acme_squares", text)
    code, facts = check(tmp_path, "yard.sq", "SQUARES\n47.002 8.0 30\n")
    assert (code, problems_of(facts)) == (3, [(1, 1, "zone-format-broken")])
    assert "package 'acme'" in facts["problems"][0]["message"]
    text = (FILES / "zones.kml").read_text("utf-8")
    counts = [check(tmp_path, name, text)[1]["zones"] for name in ("zones.kml", "zones")]
    assert counts == [4, 4]


def test_a_greedy_package_takes_none_of_our_files(tmp_path):
    greedy = SQUARES.replace('return head.startswith(b"SQUARES")', "return True")
    install(tmp_path, "acme_squares", greedy)
    _, facts = check(tmp_path, "zones.kml", (FILES / "zones.kml").read_text("utf-8"))
    assert "wrong-form" not in {each["code"] for each in facts.get("problems", ())}


@pytest.mark.parametrize(
    "line",
    ["nan 8.0 30", "47.0 8.0 nan", "47.0 8.0 0", "47.0 8.0 inf", "95 8.0 30", "47.0 284.8 30"],
)
def test_a_zone_that_is_nowhere_on_earth_is_a_problem_at_its_place(tmp_path, line):
    install(tmp_path, "acme_squares", SQUARES)
    code, facts = check(tmp_path, "yard.sq", f"SQUARES\n47.01 8.0 30\n{line}\n")
    assert (code, problems_of(facts)) == (3, [(3, 1, "not-on-earth")])
    assert facts["problems"][0]["path"].endswith("yard.sq")
