"""An edit computes anew only what it touches: in all it comes to the same as the whole text read.

The random edits wander over all kinds, and now and then leave a mission that cannot be planned.
"""

import contextlib
import copy
import gc
import json
import random
from functools import partial

import pytest

from air_router.editor import edits
from air_router.editor.editable_mission import EditableMission, MissionAnalysis
from air_router.editor.parts import EditError
from air_router.editor.server import changes_of
from air_router.editor.view import view

STEPS = 40


def beside(chance, at, reach_deg=2e-4):
    return tuple(value + chance.uniform(-reach_deg, reach_deg) for value in at)


def corners_of(area):
    return [
        ((*ring["keys"], index), at)
        for ring in area["rings"]
        for index, at in enumerate(ring["corners"])
    ]


def any_edit(chance, shown):
    """An edit of what is shown, or the name of what a session does by itself."""
    places = [place for place in shown["places"] if place["keys"]]
    waypoints = [place for place in places if place["kind"] == "waypoint"]
    zones = [area for area in shown["areas"] if not area["fence"]]
    place, waypoint = chance.choice(places), chance.choice(waypoints)
    area, zone = chance.choice(shown["areas"]), chance.choice(zones)
    keys, waypoint_keys = tuple(area["keys"]), tuple(waypoint["keys"])
    corners = corners_of(area) or [(keys, area["circle"]["centre"])]
    corner, at = chance.choice(corners)
    values = {"clearance_m": 6.0, "max_edge_m": 60.0, "tracking_margin_m": 1.0, "altitude_m": 45.0}
    name, value = chance.choice([*values.items()])
    shift = partial(edits.Shift, do="shift", keys=tuple(zone["keys"]))
    return chance.choice(
        [
            edits.Move(do="move", keys=tuple(place["keys"]), to=beside(chance, place["at"])),
            edits.Move(do="move", keys=waypoint_keys, to=beside(chance, waypoint["at"], 1e-5)),
            edits.Move(do="move", keys=corner, to=beside(chance, at, 5e-5)),
            shift(origin=tuple(at), to=beside(chance, at, 1e-4)),
            edits.AddCorner(
                do="add_corner", keys=corner[:-1], index=corner[-1], at=beside(chance, at)
            )
            if isinstance(corner[-1], int)
            else "undo",
            edits.AddWaypoint(do="add_waypoint", index=chance.randrange(5), at=beside(chance, at)),
            edits.AddArea(do="add_area", corners=(beside(chance, at),), radius_m=5.0),
            edits.Remove(do="remove", keys=chance.choice([waypoint_keys, corner, keys])),
            edits.SetAltitude(do="set_altitude", keys=waypoint_keys, altitude_m=30.0),
            edits.SetValue(do="set_value", name=name, value=value),
            "undo",
            "redo",
        ]
    )


@pytest.mark.parametrize("seed", range(4))
def test_after_any_edits_all_is_as_if_the_text_were_read_anew(session, seed):
    chance = random.Random(seed)
    shown_there = json.loads(json.dumps(session.view()))
    for _ in range(STEPS):
        before, data = session.view(), copy.deepcopy(session.editable.document.data)
        editable = session.editable
        edit = any_edit(chance, before)
        with contextlib.suppress(EditError):
            session.edit(edit) if not isinstance(edit, str) else getattr(session, edit)()
        assert editable.document.data == data, "an edit has changed the state before it"
        read = EditableMission.read(session.editable.text, session.editable.path)
        whole = view(read.parts, MissionAnalysis.of(read))
        shown = session.view()
        assert {name: shown[name] for name in whole} == whole, edit
        shown_there = taken(shown_there, json.loads(json.dumps(changes_of(before, shown))))
        assert shown_there == json.loads(json.dumps(shown)), edit


def taken(state, update):
    """The state of a page after an update."""
    state = {**state}
    for name, value in update.items():
        if isinstance(state[name], list):
            entries = dict(enumerate(state[name])) | {int(i): new for i, new in value["at"].items()}
            state[name] = [entries[index] for index in range(value["length"])]
        else:
            state[name] = value
    return state


def test_a_moved_waypoint_is_all_that_pages_are_sent(session):
    before = session.view()
    at = before["places"][5]["at"]
    session.edit(edits.Move(do="move", keys=("waypoints", 4, "position"), to=(at[0] + 1e-6, at[1])))
    update = changes_of(before, session.view())
    assert set(update["places"]["at"]) == {5}
    assert set(update["legs"]["at"]) == {4, 5}
    assert "areas" not in update
    assert "problems" not in update


def test_another_altitude_leaves_the_paths_as_they_are(session):
    before = MissionAnalysis.of(session.editable).graph
    keys = ("waypoints", 4, "position")
    session.edit(edits.SetAltitude(do="set_altitude", keys=keys, altitude_m=31.0))
    after = MissionAnalysis.of(session.editable).graph
    assert after.mission.cruise != before.mission.cruise
    assert after.paths is before.paths


def test_edits_leave_no_garbage_in_circles(session):
    """The program that serves the page does not search for any."""
    chance = random.Random(5)
    gc.collect()
    gc.disable()
    try:
        for _ in range(STEPS):
            edit = any_edit(chance, session.view())
            with contextlib.suppress(EditError):
                session.edit(edit) if not isinstance(edit, str) else getattr(session, edit)()
        assert gc.collect() == 0
    finally:
        gc.enable()
