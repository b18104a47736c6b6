"""Whatever stands in a mission file: a mission, or problems with places and codes; no crash."""

import copy
import json
import re
import tempfile
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from air_router.errors import MissionFileError
from air_router.mission.loading import load_mission
from mocha_link.team.document import Document
from tests.air_router.mission.test_mission_errors import FILE, MONDAY

GOOD = Document.from_text(FILE, Path("mission.yaml")).data

numbers = st.sampled_from([0, -1, 1e-9, 89.9999, 181, 1e7, 1e18, 1e308, -1e308, 5e-324])
words = st.sampled_from(
    ["", "x", "fence", "home", "null", "2026-11-20T08:00:00Z", "08:00", "é\n#: [", "ground"]
)
junk = st.recursive(
    st.none() | st.booleans() | numbers | words,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=2),
    max_leaves=6,
)


def spots(value, keys=()):
    """The ways to all values."""
    yield keys
    for key, inner in (
        value.items()
        if isinstance(value, dict)
        else enumerate(value if isinstance(value, list) else ())
    ):
        yield from spots(inner, (*keys, key))


SPOTS = [keys for keys in spots(GOOD) if keys]


def at(data, keys):
    for key in keys:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return None
    return data


@given(st.lists(st.tuples(st.sampled_from(SPOTS), st.booleans(), junk), min_size=1, max_size=3))
def test_any_value_in_any_place_is_read_or_refused(changes):
    data = copy.deepcopy(GOOD)
    for keys, drop, value in changes:
        parent = at(data, keys[:-1])
        if isinstance(parent, dict) or (
            isinstance(parent, list) and keys[-1] in range(len(parent))
        ):
            if drop:
                parent.pop(keys[-1], None) if isinstance(parent, dict) else parent.pop(keys[-1])
            else:
                parent[keys[-1]] = value
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mission.yaml"
        path.write_text(json.dumps(data, ensure_ascii=False), encoding="utf-8")
        mission, problems = None, ()
        try:
            mission = load_mission(path, start=MONDAY)
        except MissionFileError as error:
            problems = error.problems
    for problem in problems:
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", problem.code)
        assert (problem.line, problem.column) >= (1, 1)
    if mission is None:
        assert problems
        return
    margin_m = mission.planner.tracking_margin_m
    for waypoint in mission.waypoints:
        assert mission.planning_airspace.point_clear(waypoint.position)
    assert mission.climb_airspace.with_margin(margin_m).point_clear(mission.home)
