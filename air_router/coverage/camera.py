"""Cameras that point straight down: how much ground a picture shows."""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from air_router.errors import UsageError


@dataclass(frozen=True, slots=True)
class SurveyCamera:
    """A camera with its longer side across the direction of flight.

    Attributes:
        name: What people call it.
        across: Width of the picture on the ground, in heights above it.
        along: Length of the picture on the ground, in heights above it.
        pixels: Pixels of the picture (across, along); None if unknown.
    """

    name: str
    across: float
    along: float
    pixels: tuple[int, int] | None = None

    @property
    def turned(self) -> SurveyCamera:
        """The same camera with its longer side along the direction of flight."""
        pixels = None if self.pixels is None else self.pixels[::-1]
        return SurveyCamera(self.name, self.along, self.across, pixels)

    def footprint_m(self, height_m: float) -> tuple[float, float]:
        """What a picture from so high above the ground shows (across, along), in metres."""
        return self.across * height_m, self.along * height_m

    def pixel_m(self, height_m: float) -> float | None:
        """The side of a pixel on the ground; None if the camera's pixels are unknown."""
        return None if self.pixels is None else self.across * height_m / self.pixels[0]


def _lens(name: str, sensor_mm: tuple[float, float], focal_mm: float, *pixels: int) -> SurveyCamera:
    across, along = (side / focal_mm for side in sensor_mm)
    return SurveyCamera(name, across, along, (pixels[0], pixels[1]) if pixels else None)


CAMERAS: Final = MappingProxyType(
    {
        camera.name: camera
        for camera in (
            _lens("canon-eos-m-22mm", (22.3, 14.9), 22.0, 5184, 3456),
            _lens("canon-g9x", (13.2, 8.8), 10.2, 5488, 3680),
            _lens("canon-s100", (7.6, 5.7), 5.2, 4000, 3000),
            _lens("gopro-hero4", (6.17, 4.55), 2.98, 4000, 3000),
            _lens("parrot-sequoia", (6.17, 4.63), 4.9, 4608, 3456),
            _lens("rededge", (4.8, 3.6), 5.5, 1280, 960),
            _lens("ricoh-gr2", (23.7, 15.7), 18.3, 4928, 3264),
            _lens("sentera-6x", (6.57, 4.93), 8.0, 1904, 1428),
            _lens("sony-a6000-16mm", (23.5, 15.6), 16.0, 6000, 4000),
            _lens("sony-a6000-35mm", (23.5, 15.6), 35.0, 6000, 4000),
            _lens("sony-a7r2-28mm", (35.814, 23.876), 28.0, 7952, 5304),
            _lens("sony-a7r4-35mm", (35.7, 23.8), 35.0, 9504, 6336),
            _lens("sony-qx1-16mm", (23.2, 15.4), 16.0, 5456, 3632),
            _lens("sony-rx0", (13.2, 8.8), 7.7, 4800, 3200),
            _lens("sony-rx1r2", (35.9, 24.0), 35.0, 7952, 5304),
            _lens("sony-rx100m2", (13.2, 8.8), 10.4, 5472, 3648),
            _lens("wiris-security-thermal", (13.6, 10.2), 35.0, 800, 600),
            _lens("yuneec-e90", (13.3056, 8.656), 8.29, 5472, 3648),
        )
    }
)
"""Sensor sizes, focal lengths and pixels as QGroundControl has them (CameraMetaData.json)."""

_NUMBER = r"(\d+(?:\.\d+)?)"
_SENSOR = re.compile(rf"{_NUMBER}x{_NUMBER}/{_NUMBER}(?:@(\d+)x(\d+))?")
_ANGLES = re.compile(rf"{_NUMBER}x{_NUMBER}deg")


def camera_of(text: str) -> SurveyCamera:
    """A camera by its name, by sensor and focal length, or by its angles of view.

    `13.2x8.8/10.4` is a sensor of 13.2 mm x 8.8 mm behind a lens of 10.4 mm, `@5472x3648` after it
    its pixels; `60x45deg` sees 60 degrees across and 45 along.

    Raises:
        UsageError: it is none of these.
    """
    if text in CAMERAS:
        return CAMERAS[text]
    if match := _SENSOR.fullmatch(text):
        width, height, focal = map(float, match.groups()[:3])
        if min(width, height, focal) > 0:
            pixels = [int(side) for side in match.groups()[3:] if side is not None]
            return _lens(text, (width, height), focal, *pixels)
    if match := _ANGLES.fullmatch(text):
        across, along = (math.tan(math.radians(float(angle)) / 2) * 2 for angle in match.groups())
        if all(0 < float(angle) < 170 for angle in match.groups()):
            return SurveyCamera(text, across, along)
    close = difflib.get_close_matches(text, CAMERAS, n=1)
    hint = f"did you mean {close[0]}? " if close else ""
    raise UsageError(
        f"no camera '{text}'; {hint}"
        "give SENSOR_WIDTHxHEIGHT/FOCAL in mm (13.2x8.8/10.4), ACROSSxALONGdeg (60x45deg), or one "
        f"of {', '.join(CAMERAS)}"
    )
