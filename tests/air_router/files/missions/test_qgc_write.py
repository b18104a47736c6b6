"""Plans: whatever they hold is left alone by reading, and what is written flies the same."""

from pathlib import Path

import pytest

from air_router.files.json_document import json_from_text, json_text, load_json
from air_router.files.missions.qgc_read import plan_draft
from air_router.files.missions.qgc_write import ConversionWarnings, plan_of

DATA = Path(__file__).parents[3] / "data"
PLANS = [DATA / "pennovation.plan", DATA / "files" / "survey.plan"]


@pytest.mark.parametrize("path", PLANS, ids=lambda path: path.stem)
def test_a_plan_that_is_written_anew_flies_the_same(path):
    draft = plan_draft(load_json(path))
    warnings = ConversionWarnings()
    text = json_text(plan_of(draft, warnings))
    again = plan_draft(json_from_text(text, path))
    assert again.problems == []
    assert again.notes == []
    assert (again.altitude_m, again.speed_m_s) == (draft.altitude_m, draft.speed_m_s)
    assert again.home_altitude_amsl_m == draft.home_altitude_amsl_m
    for name in ("waypoints", "rally_points"):
        for mine, theirs in zip(getattr(again, name), getattr(draft, name), strict=True):
            assert mine.position == pytest.approx(theirs.position, abs=1e-4)
            assert mine.altitude_m == theirs.altitude_m
    for name in ("fences", "zones"):
        shapes = [[area.shape for area in getattr(each, name)] for each in (again, draft)]
        for mine, theirs in zip(*(sorted(s, key=kind) for s in shapes), strict=True):
            assert mine.polygon.symmetric_difference(theirs.polygon).area < 0.1
    assert warnings.entries == []


def kind(shape):
    return type(shape).__name__, shape.polygon.area
