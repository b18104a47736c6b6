"""Whatever is done to a mission, in any order: what was asked for happens, the rest stays."""

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from air_router.editor import edits
from air_router.editor.editable_mission import EditableMission
from air_router.editor.parts import EditError
from air_router.files.text_edit import SourceError

ROOT = Path(__file__).parents[3]
HARBOUR = (ROOT / "tests/data/files/harbour.yaml").read_text(encoding="utf-8")
TEXTS = {
    "pennovation.yaml": (ROOT / "missions/pennovation/mission.yaml").read_text(encoding="utf-8"),
    "pennovation.plan": (ROOT / "tests/data/pennovation.plan").read_text(encoding="utf-8"),
    "harbour.yaml": HARBOUR,
    "harbour-crlf.yaml": HARBOUR.replace("\n", "\r\n"),
}

places = st.tuples(
    st.floats(-89, 89).map(lambda degrees: round(degrees, 7)),
    st.floats(-179, 179).map(lambda degrees: round(degrees, 7)),
)


def remarks(text):
    return re.findall(r"#[^\r\n]*", text)


def handles(editable):
    return list(editable.parts.handles())


def pairs(editable):
    return sorted(handle.pair for handle in handles(editable))


class Hand:
    """Does something to a mission, and looks whether just that has happened."""

    def __init__(self, draw, editable):
        self.draw = draw
        self.editable = editable

    def pick(self, things):
        return self.draw(st.sampled_from(list(things)))

    def act(self):
        ways = [self.move, self.remove, self.remove_area, self.resize, self.name, self.set_altitude]
        ways += [self.add_corner, self.add_waypoint, self.add_rally_point, self.add_area]
        ways += [self.reorder, self.reverse]
        self.pick(ways)()

    def do(self, edit):
        before = self.editable
        self.editable = before.edited(edit)
        return before

    def move(self):
        handle, to = self.pick(handles(self.editable)), self.draw(places)
        before = self.do(edits.Move(do="move", keys=handle.keys, to=to))
        for old, new in zip(handles(before), handles(self.editable), strict=True):
            assert new.pair == pytest.approx(to if old.keys == handle.keys else old.pair, abs=6e-8)
        assert remarks(self.editable.text) == remarks(before.text)
        lines = before.text.split("\n"), self.editable.text.split("\n")
        changed = sum(old != new for old, new in zip(*lines, strict=True))
        assert changed <= (1 if "[" in before.text and "plan" not in before.path.name else 2) + 1

    def remove(self):
        handle = self.pick(handles(self.editable))
        try:
            before = self.do(edits.Remove(do="remove", keys=handle.keys))
        except EditError:
            return
        left = pairs(before)
        left.remove(handle.pair)
        assert pairs(self.editable) == left

    def remove_area(self):
        region = self.pick(self.editable.parts.regions)
        if region.entry is None or len(self.editable.parts.regions) < 3:
            return
        before = self.do(edits.Remove(do="remove", keys=region.keys))
        kept = [h.pair for h in handles(before) if h.keys[: len(region.keys)] != region.keys]
        assert pairs(self.editable) == sorted(kept)

    def added(self, edit, *new):
        before = self.do(edit)
        assert pairs(self.editable) == sorted([*pairs(before), *new])
        assert remarks(self.editable.text) == remarks(before.text)

    def add_corner(self):
        rings = [r for region in self.editable.parts.regions for r in region.rings]
        if rings:
            ring, at = self.pick(rings), self.draw(places)
            index = self.draw(st.integers(0, len(ring.corners)))
            self.added(edits.AddCorner(do="add_corner", keys=ring.keys, index=index, at=at), at)

    def add_waypoint(self):
        at = self.draw(places)
        index = self.draw(st.integers(0, len(self.editable.parts.waypoints)))
        self.added(edits.AddWaypoint(do="add_waypoint", index=index, at=at), at)
        assert self.editable.parts.waypoints[index].pair == at

    def reorder(self):
        order = self.editable.parts.waypoints[:]
        handle = self.pick(order)
        index = self.draw(st.integers(0, len(order) - 1))
        before = self.do(edits.Reorder(do="reorder", keys=handle.keys, index=index))
        order.remove(handle)
        order.insert(index, handle)
        self.ordered(before, order)

    def reverse(self):
        order = self.editable.parts.waypoints[::-1]
        self.ordered(self.do(edits.Reverse(do="reverse")), order)

    def ordered(self, before, order):
        assert [h.pair for h in self.editable.parts.waypoints] == [h.pair for h in order]
        assert pairs(self.editable) == pairs(before)

    def add_rally_point(self):
        at = self.draw(places)
        self.added(edits.AddRallyPoint(do="add_rally_point", at=at), at)

    def add_area(self):
        corners = self.draw(st.lists(places, min_size=3, max_size=4).map(tuple))
        radius_m = self.draw(st.none() | st.floats(0.5, 500))
        corners = corners[:1] if radius_m else corners
        self.added(edits.AddArea(do="add_area", corners=corners, radius_m=radius_m), *corners)

    def resize(self):
        circles = [r for r in self.editable.parts.regions if r.circle]
        if circles:
            region = self.pick(circles)
            self.do(edits.Resize(do="resize", keys=region.keys, radius_m=12.345))
            after = {r.keys: r for r in self.editable.parts.regions}
            assert after[region.keys].circle.radius_m == pytest.approx(12.3)

    def name(self):
        zones = [r for r in self.editable.parts.regions if not r.is_fence]
        if not zones:
            return
        region, name = self.pick(zones), self.draw(st.sampled_from(["hall", "no: 1", "#2", "true"]))
        try:
            before = self.do(edits.Rename(do="rename", keys=region.keys, name=name))
        except EditError:
            assert self.editable.path.suffix == ".plan"
            return
        after = {r.keys: r.name for r in self.editable.parts.regions}
        assert after[region.keys] == name
        assert pairs(self.editable) == pairs(before)

    def set_altitude(self):
        handle = self.pick(self.editable.parts.waypoints)
        altitude_m = self.draw(st.sampled_from([None, 30.0, 41.25]))
        if altitude_m is None and self.editable.path.suffix == ".plan":
            return
        edit = edits.SetAltitude(do="set_altitude", keys=handle.keys, altitude_m=altitude_m)
        before = self.do(edit)
        assert pairs(self.editable) == pairs(before)


@pytest.mark.parametrize("name", TEXTS)
@settings(max_examples=4)
@given(data=st.data())
def test_any_edits_in_any_order(name, data):
    hand = Hand(data.draw, EditableMission.read(TEXTS[name], Path(name)))
    for _ in range(8):
        hand.act()
    again = EditableMission.read(hand.editable.text, Path(name))
    assert handles(again) == handles(hand.editable)


def test_what_an_alias_shares_is_not_edited():
    text = HARBOUR.replace("[54.3205, 10.1405],", "&a [54.3205, 10.1405],").replace(
        "[54.3220, 10.1390]", "*a"
    )
    editable = EditableMission.read(text, Path("harbour.yaml"))
    assert len(editable.parts.waypoints) == 3
    for number in (0, 2):
        keys = ("waypoints", number, "position")
        with pytest.raises(SourceError, match="alias"):
            editable.edited(edits.Move(do="move", keys=keys, to=(54.0, 10.0)))
