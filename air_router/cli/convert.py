"""`air-router convert`: a mission or zones in another format, and what got lost on the way."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import click

from air_router.cli.arguments import ANY_FINITE, MORE_THAN_0, note_options, number, print_json
from air_router.errors import ExitCode, UsageError
from air_router.files import (
    Findings,
    JsonDocument,
    json_text,
    kmz_of,
    write_whole,
)
from air_router.files.maps import (
    FeatureSet,
    feature_set_of_zones,
    geojson_text,
    kml_text,
    read_zones,
)
from air_router.files.missions import (
    NOT_FLOWN,
    ConversionWarnings,
    PlacedForm,
    feature_set_of,
    mission_text,
    plan_of,
    report_settings,
    with_zones,
)
from air_router.mission import is_mission, read_foreign, read_placed, validate
from air_router.record import Log
from air_router.words import counted
from mocha_link.cli import PATH, Options, Parsed, command, option
from mocha_link.errors import needs_extra
from mocha_link.team import DocumentError, Problem

_PLAN, _YAML, _GEOJSON, _KML = "plan", "mission", "GeoJSON", "KML"
_KMZ = "KMZ"
_FOXGLOVE = "Foxglove"
_KINDS: Final = {
    ".plan": _PLAN,
    ".yaml": _YAML,
    ".yml": _YAML,
    ".geojson": _GEOJSON,
    ".json": _GEOJSON,
    ".kml": _KML,
    ".kmz": _KMZ,
    ".mcap": _FOXGLOVE,
}
_MAP_WRITERS: Final[dict[str, Callable[[FeatureSet], str | bytes]]] = {
    _GEOJSON: geojson_text,
    _KML: kml_text,
    _KMZ: lambda feature_set: kmz_of(kml_text(feature_set)),
}
_RECORD: Final = ".mcap"
_LOSING: Final = frozenset({_RECORD, ".yaml", ".yml"})  # written anew they lack something

_EPILOG = """\
FROM is a flight's record (.mcap; TO is then .mcap with channels for Foxglove and Rerun); or a
mission (.yaml, .plan, waypoints and fences of ArduPilot's programs, .gpx with --altitude); or
a file of zones (.geojson, .kml, .kmz, .gpx, OpenAir .txt or .air, .json with ED-269 or ED-318
geozones). TO is .plan, .yaml, .geojson, .kml or .kmz; for zones alone one of the last three.

examples:
  air-router convert town.plan town.yaml
  air-router convert mission.yaml map.kml
  air-router convert mission.yaml with_zones.plan --zones geozones.json --zones site.kml
  air-router convert geozones.json geozones.geojson --allow CONDITIONAL
  air-router convert flight.mcap shown.mcap

exit codes: 0 written, 1 cannot be written, 2 wrong usage (or TO exists and no --force),
3 a file is invalid
"""


@command(
    "Convert a mission, zones or a flight's record; list what the new format cannot represent.",
    _EPILOG,
)
@click.argument("source", type=PATH, metavar="FROM", help="mission, zones or flight record to read")
@click.argument(
    "target", type=PATH, metavar="TO", help="file to write; its extension selects the format"
)
@option(
    "--zones",
    multiple=True,
    type=PATH,
    metavar="F",
    help="add the no-fly zones of file F; may be repeated",
)
@option(
    "--allow",
    multiple=True,
    metavar="NAME",
    help="permit, and so leave out, zones with this restriction (CONDITIONAL, ...), class or "
    "identifier; may be repeated",
)
@option(
    "--skip",
    multiple=True,
    metavar="NAME",
    help="leave out zones of this name or kind as irrelevant; may be repeated",
)
@option(
    "--altitude",
    type=Parsed(number("an altitude above 0 meters", MORE_THAN_0, ANY_FINITE)),
    metavar="M",
    help="altitude above home at which a GPX route is flown, in meters",
)
@option("--force", is_flag=True, help="replace TO if it exists")
@option("--json", is_flag=True, help="print one JSON object on stdout")
def run(arguments: Options) -> int:
    """Convert, and report what got lost."""
    source, target = arguments.source, arguments.target
    kind = _KINDS.get(target.suffix.lower())
    if kind is None:
        known = ", ".join(dict.fromkeys(_KINDS))
        raise UsageError(f"{target}: unknown kind of file; TO ends with one of {known}")
    if target.exists() and not arguments.force:
        raise UsageError(f"{target} is already there; --force replaces it")
    if target.suffix.lower() in _LOSING and target.resolve() == source.resolve():
        raise UsageError(f"{target} is the file that is read, and would lose; write another one")
    note_options(arguments, {"altitude": "altitude_m"})
    report = _Report(source, target)
    read = _zones
    if is_mission(source) or arguments.altitude is not None:
        read = _mission
    if source.suffix.lower() == _RECORD or kind == _FOXGLOVE:
        read = _record
    try:
        written = read(arguments, kind, report)
    except DocumentError as error:
        report.problems = error.problems
        if arguments.json:
            report.print(as_json=True)
        raise
    write_whole(target, written, replace=arguments.force)
    report.written = True
    report.print(as_json=arguments.json)
    return ExitCode.DONE


class _Report:
    """What was written, what got lost, and further notes."""

    def __init__(self, source: Path, target: Path) -> None:
        self.source, self.target = source, target  # of the conversion
        self.written = False  # the target, to its end
        self.counts: dict[str, int] = {}  # the contents of the target, by noun
        self.warnings = ConversionWarnings()
        self.notes: Sequence[Problem] = ()  # on the source, for the operator
        self.problems: Sequence[Problem] = ()  # why it cannot be flown

    def print(self, *, as_json: bool) -> None:
        if as_json:
            print_json(self._facts())
            return
        for note in self.notes:
            sys.stderr.write(f"note: {note}\n")
        for loss in self.warnings.entries:
            sys.stderr.write(f"not carried over: {loss}\n")
        if self.problems:
            sys.stderr.write(
                f"it cannot be flown yet: {counted(len(self.problems), 'problems')}; "
                f"see `air-router check {self.source}`\n"
            )
        counts = ", ".join(counted(count, what) for what, count in self.counts.items() if count)
        sys.stdout.write(f"{self.target}: {counts or 'nothing'}\n")

    def _facts(self) -> dict[str, Any]:
        return {
            "from": str(self.source),
            "to": str(self.target),
            "written": self.written,
            **{w.removeprefix("no-fly ").replace(" ", "_"): n for w, n in self.counts.items()},
            "not_carried_over": [asdict(loss) for loss in self.warnings.entries],
            "notes": [note.as_json() for note in self.notes],
            "problems": [problem.as_json() for problem in self.problems],
        }


def _record(arguments: Options, kind: str, report: _Report) -> bytes:
    if arguments.source.suffix.lower() != _RECORD or kind != _FOXGLOVE:
        raise UsageError(
            "a flight's record (.mcap) becomes .mcap with Foxglove's schemas; nothing else does"
        )
    log = Log(arguments.source)
    with needs_extra("a file for Foxglove", "foxglove", "air-router"):
        from air_router.record import foxglove_mcap  # noqa: PLC0415 - an extra
    written = foxglove_mcap(log)
    if log.ending is not None:
        report.warnings.add("the rest", f"the record is not whole: {log.ending}", "record-cut")
    report.counts = {"bytes": len(written)}
    return written


def _mission(arguments: Options, kind: str, report: _Report) -> str | bytes:
    source, allow, skip = arguments.source, arguments.allow, arguments.skip
    placed, findings = read_foreign(source, altitude_m=arguments.altitude) or read_placed(source)
    own_zones = len(placed.zones)
    for path in arguments.zones:
        placed = placed.with_zones_of(path, (), findings, allow=allow, skip=skip)
    if findings.problems or placed.frame is None or placed.home is None:
        raise DocumentError(findings.problems)
    document = findings.source
    if kind != _PLAN or not isinstance(document, JsonDocument):
        for note in findings.notes:
            if note.code == NOT_FLOWN:
                report.warnings.add(f"{note.path}:{note.line}", note.message, "item-lost")
    report.counts = {
        "waypoints": len(placed.waypoints),
        "fences": len(placed.fences),
        "no-fly zones": len(placed.zones),
        "rally points": len(placed.rally_points),
    }
    if kind in _MAP_WRITERS:
        text = _MAP_WRITERS[kind](feature_set_of(placed))
        report_settings(placed.form, report.warnings, f"a {kind} file")
    elif kind == _YAML:
        _refuse_without_waypoints(placed, findings)
        text = mission_text(placed, arguments.target.parent)
        if not isinstance(document, JsonDocument):
            report.warnings.add("comments", "they stay in the file that is read", "comments-lost")
    elif isinstance(document, JsonDocument):
        added = placed.zones[own_zones:]
        text = with_zones(document, added, placed.frame, report.warnings)
    else:
        text = json_text(plan_of(placed, report.warnings))
    validate(placed, findings)
    report.notes, report.problems = findings.notes, findings.problems
    return text


def _refuse_without_waypoints(placed: PlacedForm, findings: Findings) -> None:
    """Without waypoints there is no altitude: no mission file could be read again."""
    if not placed.waypoints:
        message = (
            "no waypoints in it, so no place and no altitude to fly to; add one, or convert "
            "its fence and zones to .geojson, .kml or .plan"
        )
        findings.report((), message, "no-waypoints")
        raise DocumentError(findings.problems)


def _zones(arguments: Options, kind: str, report: _Report) -> str | bytes:
    if kind not in _MAP_WRITERS and arguments.source.suffix.lower() == ".gpx":
        raise UsageError("GPX has no altitude to fly at: add --altitude M, above home")
    if kind not in _MAP_WRITERS:
        raise UsageError(
            "zones alone are no mission: give the mission as FROM and these with --zones"
        )
    readings = [
        read_zones(path, allow=arguments.allow, skip=arguments.skip)
        for path in (arguments.source, *arguments.zones)
    ]
    features, repairs = feature_set_of_zones(readings, arguments.source.stem)
    unread = [problem for reading in readings for problem in reading.unread]
    problems = [problem for reading in readings for problem in reading.problems]
    if len(problems) > len(unread) or (problems and not features.zones):
        raise DocumentError(problems)
    for problem in unread:
        place = f"{problem.path}:{problem.line}:{problem.column}"
        report.warnings.add(place, problem.message, problem.code)
    report.counts = {"no-fly zones": len(features.zones)}
    report.notes = [*(note for reading in readings for note in reading.notes), *repairs]
    return _MAP_WRITERS[kind](features)
