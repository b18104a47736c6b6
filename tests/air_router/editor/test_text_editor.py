"""Whatever is done to a mission, in any order: what was requested happens, the rest stays.

Every line of a YAML file that an edit is not about is there afterwards byte for byte, and every
line that is a comment, in the same order.
"""

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
    **{
        f"{path.parent.name}.yaml": path.read_text(encoding="utf-8")
        for path in sorted((ROOT / "missions").glob("*/mission.yaml"))
    },
    "pennovation.plan": (ROOT / "tests/data/pennovation.plan").read_text(encoding="utf-8"),
    "harbour.yaml": HARBOUR,
    "harbour-crlf.yaml": HARBOUR.replace("\n", "\r\n"),
}

places = st.tuples(st.floats(-89, 89), st.floats(-179, 179))
shares = st.floats(-1, 1)


def remarks(text):
    return re.findall(r"#[^\r\n]*", text)


def is_comment(line):
    return line.lstrip().startswith("#")


def lines_of(document, *keys):
    """The first line of a value, and the one behind its last."""
    node = document.node(*keys)
    first, last = node.start_mark.line, node.end_mark.line
    if last > first and not node.end_mark.column:
        last -= 1
    return first, last + 1


def about(editable, edit):
    """The part of the file that an edit is about; None if it begins something new."""
    document = editable.document
    keys = (
        getattr(edit, "keys", None)
        or {
            "add_waypoint": ("waypoints",),
            "reverse": ("waypoints",),
            "add_rally_point": ("rally_points",),
            "add_area": ("no_fly_zones",),
            "set_value": (getattr(edit, "name", ""),),
            "seek": ("seek",),
        }[edit.do]
    )
    if edit.do in ("reorder", "remove"):
        keys = keys[:1]
    return keys if document.node(*keys) is not document.node() else None


def check_the_rest(before, after, edit):
    """What an edit is not about is as it was."""
    old, new = before.text.split("\n"), after.text.split("\n")
    keys = about(before, edit)
    first, behind = (len(old), len(old)) if keys is None else lines_of(before.document, *keys)
    if old == new:
        return
    if keys is None:
        assert len(new) > len(old)
        same = (a == b for a, b in zip(old, new, strict=False))
        first = behind = next((i for i, equal in enumerate(same) if not equal), len(old) - 1)
    first -= 1  # the key of a list, which may have been empty
    assert new[:first] == old[:first]
    assert new[len(new) - (len(old) - behind) :] == old[behind:]
    if edit.do != "remove" or "harbour" not in before.path.name:
        assert [*filter(is_comment, new)] == [*filter(is_comment, old)]


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

    def place(self):
        """Anywhere on Earth, or where metres reach."""
        origin = self.editable.parts.origin
        if not self.editable.parts.in_metres:
            place = self.draw(places)
        else:
            place = tuple(at + 0.002 * self.draw(shares) for at in origin)
        return tuple(round(degrees, 7) for degrees in place)

    def pair(self, place):
        """As the file has it."""
        return tuple(map(float, self.editable.parts.digits(place)))

    def act(self):
        ways = [self.move, self.remove, self.remove_area, self.resize, self.name, self.set_altitude]
        ways += [self.add_corner, self.add_waypoint, self.add_rally_point, self.add_area]
        ways += [self.reorder, self.reverse, self.shift, self.redraw, self.set_value, self.seek]
        self.pick(ways)()

    def do(self, edit):
        before = self.editable
        self.editable = before.edited(edit)
        if before.path.suffix == ".yaml":
            check_the_rest(before, self.editable, edit)
        return before

    def move(self):
        handle, to = self.pick(handles(self.editable)), self.place()
        before = self.do(edits.Move(do="move", keys=handle.keys, to=to))
        to = self.pair(to)
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
        assert pairs(self.editable) == sorted([*pairs(before), *map(self.pair, new)])
        assert remarks(self.editable.text) == remarks(before.text)

    def add_corner(self):
        rings = [r for region in self.editable.parts.regions for r in region.rings]
        if rings:
            ring, at = self.pick(rings), self.place()
            index = self.draw(st.integers(0, len(ring.corners)))
            self.added(edits.AddCorner(do="add_corner", keys=ring.keys, index=index, at=at), at)

    def add_waypoint(self):
        at = self.place()
        index = self.draw(st.integers(0, len(self.editable.parts.waypoints)))
        self.added(edits.AddWaypoint(do="add_waypoint", index=index, at=at), at)
        assert self.editable.parts.waypoints[index].pair == self.pair(at)

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
        at = self.place()
        self.added(edits.AddRallyPoint(do="add_rally_point", at=at), at)

    def add_area(self):
        corners = tuple(self.place() for _ in range(self.draw(st.integers(3, 4))))
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

    def shift(self):
        region, to = self.pick(self.editable.parts.regions), self.place()
        origin = self.editable.parts.geodetic(region.handles[0].pair)
        if origin is None or abs(to[0]) > 60:
            return
        try:
            self.do(edits.Shift(do="shift", keys=region.keys, origin=origin, to=to))
        except EditError:  # one that was drawn around half of the Earth has no such place there
            return
        after = {r.keys: r for r in self.editable.parts.regions}[region.keys]
        at = self.editable.parts.geodetic(after.handles[0].pair)
        assert at == pytest.approx(to, abs=1e-4)

    def redraw(self):
        regions = [region for region in self.editable.parts.regions if len(region.rings) < 2]
        if not regions:
            return
        region, number = self.pick(regions), self.draw(st.integers(3, 5))
        corners = tuple(self.place() for _ in range(number))
        self.do(edits.Redraw(do="redraw", keys=region.keys, corners=corners))

    def set_value(self):
        name = self.draw(st.sampled_from(["duration_s", "endurance_s", "uav", "search_s"]))
        value = self.draw(st.sampled_from([None, 600.0, 1234.5]))
        value = "io" if name == "uav" and value else value
        edit = edits.SetValue(do="set_value", name=name, value=value)
        if self.editable.path.suffix == ".plan":
            return
        if name == "search_s":  # in a section of its own
            timers = self.editable.document.data.get("timers") or {}
            self.editable = self.editable.edited(edit)
            timers = {k: v for k, v in {**timers, name: value}.items() if v is not None}
            assert (self.editable.document.data.get("timers") or {}) == timers
            return
        self.do(edit)
        assert self.editable.document.data.get(name) == value

    def seek(self):
        robots = self.draw(st.lists(st.sampled_from(["io", "ariel", "no: 1"]), min_size=1))
        if self.editable.path.suffix == ".plan":
            return
        self.do(edits.Seek(do="seek", robots=tuple(robots)))
        seek = self.editable.document.data["seek"]
        assert robots == (seek["robots"] if isinstance(seek, dict) else seek)

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
