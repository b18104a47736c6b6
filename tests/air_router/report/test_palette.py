"""One set of colours: the pages', the pictures', the report's."""

import re
from importlib import resources

from air_router.report import map_sheet
from air_router.report.palette import colours, style_sheet


def test_pictures_and_reports_have_the_pages_colours():
    light, dark = colours(), colours(dark=True)
    assert light.keys() == dark.keys() >= {"fence", "zone", "route", "leg", "r7"}
    assert map_sheet.FENCE == light["fence"] != dark["fence"]
    assert f"--zone: {light['zone']};" in style_sheet()
    report = resources.files("air_router.report").joinpath("flight_page.css").read_text("utf-8")
    known = set(re.findall(r"--([\w-]+):", report)) | light.keys()
    assert set(re.findall(r"var\(--([\w-]+)", report)) <= known
