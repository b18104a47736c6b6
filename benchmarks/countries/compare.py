"""Compare a country's zones as missions load them with those of an independent parser.

Every file in the folders is read by our parser and by an independent one. Then missions are planned
at some of its airspaces, spread over the file: home on the border, a waypoint 200 m away.

refused  missions with an error that is in the file
missing  airspaces that only one of the parsers finds
areas    airspaces with areas that differ by more than 0.2 %, in the file or in a mission
limits   airspaces with a different lower or upper limit
crossed  airspaces with a self-intersecting border: ours covers all enclosed ground, or more
load     CPU time for reading the file, in seconds; mission: for the slowest mission with it

The authorities' files are not redistributed, so they are not part of the repository.
"""

import argparse
import json
import math
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from air_router.files import AltitudeLimit, Reference
from air_router.files.maps import MapArea, MapCircle, read_zones
from air_router.files.missions import PlacedForm
from air_router.mission import read_placed, validate
from benchmarks.countries.independent import Limit, Zone, area_m2, polygon_area_m2, read
from geo.airspace import Circle

TOLERANCE = 2e-3
LEAST_M2 = 1_000.0
LIMIT_M = 0.5
WIDE_M = 300_000.0  # a mission's frame stretches the areas of what is wider
MISSION = """\
home: {{position: [{lat}, {lon}], altitude_amsl_m: 200}}
altitude_m: 60
waypoints: [[{near}, {lon}]]
no_fly_files: ['{path}']
"""
HEAD = (
    f"{'file':<30}{'MB':>6}{'zones':>7}{'load':>7}{'mission':>9}{'missions':>10}{'refused':>9}"
    f"{'missing':>9}{'areas':>7}{'limits':>8}{'crossed':>9}"
)


@dataclass
class Row:
    """What was found out about a file."""

    file: str
    megabytes: float
    zones: int = 0
    load_s: float = 0.0
    mission_s: float = 0.0
    missions: int = 0
    refused: int = 0
    missing: int = 0
    areas: int = 0
    limits: int = 0
    crossed: int = 0
    compared: int = 0  # zones in missions whose areas were compared, too

    def __str__(self) -> str:
        return (
            f"{self.file:<30}{self.megabytes:>6.2f}{self.zones:>7}{self.load_s:>7.2f}"
            f"{self.mission_s:>9.2f}{self.missions:>10}{self.refused:>9}{self.missing:>9}"
            f"{self.areas:>7}{self.limits:>8}{self.crossed:>9}"
        )

    @property
    def good(self) -> bool:
        """Whether nothing is refused, and the readings are the same."""
        return not (self.refused or self.missing or self.areas or self.limits)


class Comparison:
    """Both readings of a file.

    Args:
        path: The file.
        why: Print what each difference is.
    """

    def __init__(self, path: Path, *, why: bool) -> None:
        self.row = Row(path.name, path.stat().st_size / 1e6)
        self._path, self._why = path, why
        self._theirs = read(path)
        self._expected = {key: area_m2(zone) for key, zone in self._theirs.items()}
        began = time.process_time()
        self._reading = read_zones(path)
        self.row.load_s = time.process_time() - began
        self._ours: dict[int, list[MapArea]] = defaultdict(list)
        for zone in self._reading.zones:
            self._ours[_number(zone)].append(zone)

    def compare_file(self) -> None:
        """Compare every airspace of the file."""
        row, ours, theirs = self.row, self._ours, self._theirs
        row.zones = len(theirs)
        for key in ours.keys() ^ theirs.keys():
            row.missing += 1
            self._print(key, "only in one reading")
        row.crossed = sum(crossed for _, crossed in self._expected.values())
        for key in ours.keys() & theirs.keys():
            areas = [area for zone in ours[key] for area in zone.sound()[0]]
            found_m2 = sum(map(_area_m2, areas))
            if not self._same(key, found_m2):
                row.areas += 1
                self._print(key, f"{found_m2:.0f} m2, not {self._expected[key][0]:.0f}")
            if not _same_limits(ours[key], theirs[key]):
                row.limits += 1
                self._print(key, f"{ours[key][0].terms.altitudes}, not {theirs[key].limits}")

    def compare_missions(self, count: int, folder: Path) -> None:
        """Plan missions at so many of its airspaces, and compare what they have of the file."""
        keys = sorted(self._theirs)
        if len(keys) > count:
            keys = [keys[round(k * (len(keys) - 1) / max(count - 1, 1))] for k in range(count)]
        for key in keys:
            lon, lat = self._theirs[key].first
            near = lat + 0.002 * (-1 if lat > 0 else 1)
            mission = folder / "mission.yaml"
            mission.write_text(MISSION.format(lat=lat, lon=lon, near=near, path=self._path))
            began = time.process_time()
            placed, findings = read_placed(mission)
            validate(placed, findings)
            self.row.mission_s = max(self.row.mission_s, time.process_time() - began)
            self.row.missions += 1
            wrong = [problem for problem in findings.problems if problem.path == self._path]
            self.row.refused += bool(wrong)
            for problem in wrong[:3]:
                self._print(problem.line, str(problem))
            self._compare_zones(placed)

    def _compare_zones(self, placed: PlacedForm) -> None:
        """The areas of zones that a mission has as a whole."""
        places = {_place(zone): zone for zone in self._reading.zones}
        found: dict[int, float] = defaultdict(float)
        wide: set[int] = set()
        for area in placed.zones:
            key = _number(places[int(area.keys[0]), int(area.keys[1])])
            west, south, east, north = area.shape.polygon.bounds
            if len(self._ours[key]) > 1 or max(east - west, north - south) > WIDE_M:
                wide.add(key)  # of several parts some may be too far away
            circle = isinstance(area.shape, Circle)
            round_m2 = math.pi * area.shape.radius_m**2 if circle else 0.0
            found[key] += round_m2 or area.shape.polygon.area
        for key, area in found.items():
            if key in wide:
                continue
            self.row.compared += 1
            if not self._same(key, area):
                self.row.areas += 1
                self._print(key, f"in a mission {area:.0f} m2, not {self._expected[key][0]:.0f}")

    def _same(self, key: int, ours_m2: float) -> bool:
        theirs_m2, crossed = self._expected[key]
        enough = ours_m2 >= theirs_m2 * (1 - TOLERANCE) - LEAST_M2
        return enough and (crossed or ours_m2 <= theirs_m2 * (1 + TOLERANCE) + LEAST_M2)

    def _print(self, key: int, text: str) -> None:
        if self._why:
            print(f"  {self._path.name}:{key}: {text}"[:200])


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a row for each file; 1 if a mission is refused or the readings differ."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.countries",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("paths", nargs="+", type=Path, metavar="FOLDER", help="folders or files")
    parser.add_argument(
        "--missions", type=int, default=10, metavar="N", help="number of missions per file (10)"
    )
    parser.add_argument("--json", type=Path, metavar="F", help="also write the rows to F")
    parser.add_argument("--why", action="store_true", help="describe each difference")
    options = parser.parse_args(arguments)
    print(HEAD, flush=True)
    rows = []
    for path in _files(options.paths):
        comparison = Comparison(path.resolve(), why=options.why)
        comparison.compare_file()
        with tempfile.TemporaryDirectory() as folder:
            comparison.compare_missions(options.missions, Path(folder))
        rows.append(comparison.row)
        print(comparison.row, flush=True)
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))
    print(
        f"{len(rows)} files, {sum(row.zones for row in rows)} airspaces; in missions "
        f"{sum(row.compared for row in rows)} areas compared; {sum(row.missions for row in rows)} "
        f"missions, {sum(row.refused for row in rows)} refused for the file's sake"
    )
    return 0 if all(row.good for row in rows) else 1


def _files(paths: Sequence[Path]) -> Iterator[Path]:
    for path in paths:
        yield from sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]


def _number(zone: MapArea) -> int:
    """The line of its AC, or the number of its feature."""
    return next((key for key in zone.keys if isinstance(key, int)), 0)


def _place(zone: MapArea) -> tuple[int, int]:
    here = zone.problem("", "")
    return here.line, here.column


def _area_m2(area: MapArea) -> float:
    if isinstance(area.shape, MapCircle):
        return math.pi * area.shape.radius_m**2
    rings = [
        [(place.longitude_deg, place.latitude_deg) for place in ring]
        for ring in (area.shape.ring, *area.shape.holes)
    ]
    return polygon_area_m2(rings)[0]


def _same_limits(ours: Sequence[MapArea], theirs: Zone) -> bool:
    terms = [area.terms.altitudes for area in ours]
    found = {(_limit(t and t.lower, lower=True), _limit(t and t.upper)) for t in terms}
    return found == {(_rounded(lower), _rounded(upper)) for lower, upper in theirs.limits}


def _limit(limit: AltitudeLimit | None, *, lower: bool = False) -> Limit:
    if limit is None or (lower and limit.metres <= 0):
        return None
    return _rounded((limit.metres, "ground" if limit.reference is Reference.GROUND else "sea"))


def _rounded(limit: Limit) -> Limit:
    return limit and (round(limit[0] / LIMIT_M) * LIMIT_M, limit[1])
