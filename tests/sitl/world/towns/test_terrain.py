import numpy as np
import pytest

from geo.frame import Geodetic, Point
from geo.grid import GridPatch, SemanticGrid, Terrain
from sitl.world.towns.terrain import Camera, LandCover, Raster, Road, TerrainError

CAMERA = Camera(fov_across_deg=90.0, fov_along_deg=53.13010235)
TOWN = LandCover(
    vegetation=((Point(-50, -50), Point(0, -50), Point(0, 0), Point(-50, 0)),),
    roads=(Road((Point(-60, 20), Point(60, 20)), 6.0),),
    buildings=((Point(20, 15), Point(40, 15), Point(40, 45), Point(20, 45)),),
    vehicles=(Point(-30, 20), Point(10, 21)),
)
CORNERS = (Point(-60, -60), Point(60, 60))


@pytest.fixture(scope="module")
def raster():
    return Raster.draw(TOWN, CORNERS, 1.0, 0.0)


def terrain_at(raster: Raster | GridPatch, east_m: float, north_m: float) -> Terrain:
    row = int((north_m - raster.south_m) / raster.resolution_m)
    column = int((east_m - raster.west_m) / raster.resolution_m)
    return Terrain(raster.cells[row, column])


def test_the_raster_holds_what_stands_in_the_world(raster):
    assert raster.cells.shape == (120, 120)
    assert terrain_at(raster, -25.5, -25.5) is Terrain.VEGETATION
    assert terrain_at(raster, 0.5, 20.5) is Terrain.ROAD
    assert terrain_at(raster, 0.5, 23.5) is Terrain.GRASS
    assert terrain_at(raster, 30.5, 20.5) is Terrain.BUILDING  # stands on the road
    assert terrain_at(raster, -29.5, 20.5) is Terrain.VEHICLE
    assert terrain_at(raster, 50.5, -50.5) is Terrain.GRASS


def test_the_raster_aligns_with_whole_cells_and_keeps_its_margin():
    raster = Raster.draw(LandCover(), (Point(0.3, -0.2), Point(10.9, 7.1)), 0.5, 2.0)
    assert (raster.west_m, raster.south_m) == (-2.0, -2.5)
    assert raster.cells.shape == (24, 30)
    assert (raster.cells == Terrain.GRASS).all()


def test_a_world_too_large_for_its_resolution_is_refused():
    with pytest.raises(TerrainError, match="coarser"):
        Raster.draw(LandCover(), (Point(0, 0), Point(5000, 5000)), 0.5, 0.0)


def test_the_camera_sees_its_footprint_and_nothing_else(raster):
    patch = CAMERA.picture(raster, Point(0, 0), 20.0, heading_deg=0.0)
    assert patch is not None
    assert (patch.west_m, patch.south_m) == (-20, -10)
    assert patch.cells.shape == (20, 40)
    assert (patch.cells == raster.cells[50:70, 40:80]).all()


def test_a_turned_camera_sees_a_turned_footprint(raster):
    east = CAMERA.picture(raster, Point(0, 0), 20.0, heading_deg=90.0)
    assert east is not None
    assert np.count_nonzero(east.cells) == 800
    assert terrain_at(east, 0.5, 18.5) is Terrain.ROAD  # to its left
    oblique = CAMERA.picture(raster, Point(0, 0), 20.0, heading_deg=30.0)
    assert oblique is not None
    assert np.count_nonzero(oblique.cells) == pytest.approx(800, abs=20)
    assert terrain_at(oblique, oblique.west_m + 0.5, oblique.south_m + 0.5) is Terrain.UNKNOWN


@pytest.mark.parametrize(
    ("position", "height_m"),
    [(Point(0, 0), 4.9), (Point(0, 0), -3.0), (Point(500, 0), 40.0), (Point(0, -500), 40.0)],
)
def test_too_low_or_outside_of_the_world_it_sees_nothing(raster, position, height_m):
    assert CAMERA.picture(raster, position, height_m, 0.0) is None


def test_at_the_border_the_footprint_is_cut_off(raster):
    patch = CAMERA.picture(raster, Point(60, 60), 20.0, heading_deg=0.0)
    assert patch is not None
    assert patch.cells.shape == (10, 20)


def test_what_it_sees_fits_into_the_vehicles_map(raster):
    grid = SemanticGrid.blank(Geodetic(40.0, -75.0), 1.0, *CORNERS)
    patch = CAMERA.picture(raster, Point(3.2, 7.9), 37.3, heading_deg=17.0)
    assert patch is not None
    assert grid.paint(GridPatch.decode(patch.encode())) > 1000
    known = grid.cells != Terrain.UNKNOWN
    assert (grid.cells[known] == raster.cells[known]).all()
