import pytest

from air_router.coverage.camera import CAMERAS, camera_of
from air_router.errors import UsageError


def test_a_camera_by_name_by_lens_and_by_angles():
    named = camera_of("sony-rx100m2")
    assert named.footprint_m(80.0) == pytest.approx((80 * 13.2 / 10.4, 80 * 8.8 / 10.4))
    assert named.pixel_m(80.0) == pytest.approx(0.01856, abs=1e-5)
    by_lens = camera_of("13.2x8.8/10.4@5472x3648")
    assert by_lens.footprint_m(80.0) == named.footprint_m(80.0)
    assert by_lens.pixel_m(80.0) == named.pixel_m(80.0)
    assert camera_of("13.2x8.8/10.4").pixel_m(80.0) is None
    assert camera_of("90x60deg").footprint_m(10.0) == pytest.approx((20.0, 11.547), abs=1e-3)


def test_turned_the_longer_side_is_along_the_rows():
    camera = camera_of("sony-rx100m2")
    assert camera.turned.footprint_m(10.0) == camera.footprint_m(10.0)[::-1]
    assert camera.turned.pixel_m(10.0) == pytest.approx(camera.pixel_m(10.0))
    assert camera_of("60x45deg").turned.pixel_m(1.0) is None


def test_all_in_the_table_make_sense():
    for name, camera in CAMERAS.items():
        assert camera.name == name
        assert 0.1 < camera.along < camera.across < 2.5
        assert camera.pixels[0] / camera.pixels[1] == pytest.approx(
            camera.across / camera.along, rel=0.05
        )


@pytest.mark.parametrize("text", ["sony", "13.2x8.8", "0x8.8/10", "200x45deg", "13x8/0", "x"])
def test_what_is_no_camera_names_the_ways_to_write_one(text):
    with pytest.raises(UsageError, match=r"SENSOR_WIDTHxHEIGHT/FOCAL.*sony-rx100m2"):
        camera_of(text)


def test_a_misspelt_name_gets_a_hint():
    with pytest.raises(UsageError, match="did you mean rededge"):
        camera_of("redege")
