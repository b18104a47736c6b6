"""A record in Rerun, read back with Rerun's own reader."""

import pytest

from air_router.cli.cli import main
from air_router.errors import ExitCode
from geo.frame import Point

chunk = pytest.importorskip("rerun.chunk", reason="the extra `rerun` is not installed")


@pytest.fixture(scope="module")
def opened(record, tmp_path_factory):
    """Of each entity and component: the values by time, in seconds."""
    target = tmp_path_factory.mktemp("rerun") / "flight.rrd"
    assert main(["convert", str(record), str(target)]) == ExitCode.DONE
    reader = chunk.RrdReader(str(target))
    assert [entry.application_id for entry in reader.blueprints()] == ["air-router"]
    found = {}
    for each in reader.stream().to_chunks():
        batch = each.to_record_batch()
        names = batch.schema.names
        if "time" not in names:
            continue
        times = [time.timestamp() for time in batch.column(names.index("time")).to_pylist()]
        for name in names[names.index("time") + 1 :]:
            values = batch.column(names.index(name)).to_pylist()
            rows = zip(times, values, strict=True)
            found.setdefault((each.entity_path, name), []).extend(rows)
    return found


def test_a_record_opens_in_rerun_with_positions_log_and_plots(opened, pennovation):
    place = opened["/map/vehicle", "GeoPoints:positions"]
    assert len(place) == 20
    assert place[0][0] == 1.7e9
    where = pennovation.frame.to_geodetic(Point(1.0, 2.0))
    assert place[0][1][0] == pytest.approx(where)
    robot = opened["/map/robots/io", "GeoPoints:positions"][0][1][0]
    assert robot == pytest.approx(pennovation.frame.to_geodetic(Point(5.0, 6.0)))
    pose = opened["/world/vehicle", "Transform3D:translation"]
    assert pose[-1][1][0] == pytest.approx([20.0, 2.0, 40.0])
    assert [text for _, (text,) in opened["/log", "TextLog:text"]] == [
        "READY -> INIT",
        "coming home",
    ]
    assert {value for _, (value,) in opened["/plots/altitude_m", "Scalars:scalars"]} == {40.0}
    assert opened["/plots/signal_device/io", "Scalars:scalars"] == [
        (pytest.approx(1.7e9 + 23), [47.0])
    ]


def test_zones_graph_and_links_stand_in_space(opened, pennovation):
    zone = pennovation.zones[0]
    name = f"/world/scene/zone\\ {zone.name}".replace(zone.name, zone.name.replace(" ", "\\ "))
    (strip,) = opened[f"{name}/lines", "LineStrips3D:strips"][0][1]
    assert [tuple(point[:2]) for point in strip[:-1]] == [
        pytest.approx(corner, abs=1e-4) for corner in zone.shape.corners
    ]
    (link,) = opened["/world/scene/robots/io/lines", "LineStrips3D:strips"][0][1]
    assert link == [pytest.approx([20.0, 2.0, 40.0]), pytest.approx([5.0, 6.0, 0.0])]
    borders = opened["/map/mission", "GeoLineStrings:line_strings"][0][1]
    assert len(borders) == len(pennovation.zones) + len(pennovation.fences)
