"""The edit page in a real browser: Debian's Chromium, driven by Playwright.

With DOCS_IMAGES=docs/images in the environment the picture of docs/editing.md is taken anew.
"""

import contextlib
import difflib
import io
import json
import os
import re
import shutil
from pathlib import Path

import pytest
from PIL import Image

from air_router.editor.server import EditorServer
from air_router.editor.session import EditSession, MissionFile
from tests.air_router.tile_maker import around, colour_of, tile_at, write_tiles
from tests.system.looker import Looker, expect, served

pytestmark = pytest.mark.xdist_group("pages")

ROOT = Path(__file__).parents[2]
# Answers of the program can be held back, as a busy machine does.
SLOW_ANSWERS = """
globalThis.held = false;
globalThis.kept = [];
globalThis.sent = globalThis.answered = 0;
globalThis.deliver = () => kept.splice(0).forEach((take) => take());
globalThis.WebSocket = class extends WebSocket {
  set onmessage(take) {
    super.onmessage = (event) => {
      const given = () => {
        answered += JSON.parse(event.data).id === undefined ? 0 : 1;
        take(event);
      };
      if (held) kept.push(given);
      else given();
    };
  }
  send(text) {
    sent += 1;
    super.send(text);
  }
};
"""
TILES_REST = """() => {
  const tiles = [...document.querySelectorAll(".leaflet-backdrop-pane img")];
  const seen = tiles.filter((tile) => tile.naturalWidth === 256 && tile.style.opacity === "1");
  return seen.length && tiles.every((tile) => tile.style.opacity === "1")
    && !document.querySelector(".leaflet-zoom-anim");
}"""
# Zooms in until level 21: a click while it zooms is as none.
ENLARGE = """() => {
  const tiles = [...document.querySelectorAll(".leaflet-backdrop-pane img")];
  const found = tiles.some((tile) => {
    const { left, right, width } = tile.getBoundingClientRect();
    return tile.naturalWidth === 256 && width > 16 * 256 && left < 640 && right > 640;
  });
  if (!found) document.querySelector(".leaflet-control-zoom-in").click();
  return found;
}"""
# What is drawn, each with its box in the window.
DRAWN = ".place, path.area, path.buffer, path.leg, path.detour, #problems li"
LOOKS = """(drawn) => [...document.querySelectorAll(drawn)]
  .map((one) => {
    const { x, y, width, height } = one.getBoundingClientRect();
    const kind = (one.getAttribute("class") ?? "").replace(/leaflet\\S*/g, "").trim();
    return [[kind, one.title ?? "", one.textContent].join("|"), [x, y, width, height]];
  })"""


@pytest.fixture
def mission(tmp_path):
    shutil.copytree(ROOT / "missions" / "pennovation", tmp_path / "pennovation")
    return tmp_path / "pennovation" / "mission.yaml"


class EditPage(Looker):
    """The page, as a person uses it."""

    def __init__(self, page, address, script=""):
        super().__init__(page, address, script)
        self.address = address
        page.wait_for_selector(".place.waypoint")

    def place(self, name):
        return self.page.locator(f'[data-place="{name}"]')

    def zone(self, name):
        return self.page.locator(f'path.area[data-name="{name}"]')

    @staticmethod
    def middle(locator):
        box = locator.bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def drag(self, start, end):
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down()
        for step in range(1, 9):
            mouse.move(*(a + (b - a) * step / 8 for a, b in zip(start, end, strict=True)))
        mouse.up()

    def expect_problems(self, count):
        expect(self.page.locator("#count")).to_have_text(str(count))

    def expect_blocked(self, *, some):
        blocked = expect(self.page.locator("path.leg.blocked"))
        (blocked.not_to_have_count if some else blocked.to_have_count)(0)

    def save(self):
        self.page.locator("#save").click()

    def expect_saved(self):
        expect(self.page.locator("#save")).to_be_disabled()


@pytest.fixture
def open_page(browser, command):
    """Opens a page of this process, or of a program where it is started with options."""
    pages = []

    def served_by_a_program(mission, options):
        options = ("--port", 0, "--no-open", *options)
        program = command("air-router", "edit", mission, *options, starts=True)
        return program.process.stdout.readline().decode().strip(), program

    with contextlib.ExitStack() as stack:

        def open_(mission, *options, script="", **view):
            if options:
                address, program = served_by_a_program(mission, options)
            else:
                page = served(EditorServer(EditSession(MissionFile(mission))))
                (address, _), program = stack.enter_context(page), None
            context = browser.new_context(viewport={"width": 1280, "height": 800}, **view)
            stack.callback(context.close)
            pages.append(EditPage(context.new_page(), address, script))
            pages[-1].program = program
            return pages[-1]

        yield open_
    for page in pages:
        assert page.faults == []
        assert page.strangers(page.address) == [], "the page sends requests to other machines"


def expect_tiles(page):
    """Tiles are seen, each where it lies; the mission itself is in the middle."""
    page.page.wait_for_function(TILES_REST)
    seen = Image.open(io.BytesIO(page.page.screenshot())).convert("RGB")
    found = set()
    for x, y in ((120, 700), (120, 430), (800, 150), (900, 700)):
        page.page.mouse.move(x, y)
        place = map(float, page.page.locator("#pointer").inner_text().split(","))
        colours = seen.crop((x - 10, y - 10, x + 10, y + 10)).getcolors()
        found.add(max(colours)[1])
        assert max(colours)[1] == colour_of(*tile_at(17, *place))
    assert len(found) > 1


def changes(before, after):
    lines = difflib.ndiff(before.splitlines(), after.splitlines())
    return [line for line in lines if line[:1] in "+-"]


def test_a_waypoint_dragged_into_a_zone_shows_red_and_dragged_out_saves_one_value(
    mission, open_page
):
    before = mission.read_text()
    page = open_page(mission)
    page.expect_problems(0)
    page.expect_blocked(some=False)
    start = page.middle(page.place("waypoint 20"))

    page.drag(start, page.middle(page.zone("zone 2")))
    problem = page.page.locator("#problems button")  # on the way there are others
    inside = "waypoint 20 lies inside no-fly zone 'zone 2'"
    expect(problem).to_contain_text(inside)
    page.expect_problems(1)
    page.expect_blocked(some=True)
    assert "waypoint-in-zone" in problem.inner_text()
    assert "wrong" in page.place("waypoint 20").get_attribute("class")

    if folder := os.environ.get("DOCS_IMAGES"):
        page.page.mouse.move(880, 640)
        page.page.screenshot(path=Path(folder) / "edit.png")

    page.drag(page.middle(page.place("waypoint 20")), (start[0] + 12, start[1] + 3))
    page.expect_problems(0)
    page.expect_blocked(some=False)
    page.save()
    page.expect_saved()
    old, new = changes(before, mission.read_text())
    assert old == "-   - [39.9418289, -75.2001800]  # 20"
    assert new.startswith("+   - [39.94")
    assert new.endswith("]  # 20")


def test_a_place_stays_in_the_hand_while_answers_to_the_drag_before_still_come(mission, open_page):
    page = open_page(mission, script=SLOW_ANSWERS)
    mouse, evaluate = page.page.mouse, page.page.evaluate
    start = page.middle(page.place("waypoint 20"))
    inside = page.middle(page.zone("zone 2"))
    beside = (start[0] + 12, start[1] + 3)

    evaluate("held = true")
    page.drag(start, beside)
    mouse.down()
    mouse.move(*inside, steps=4)
    evaluate("held = false; deliver()")
    page.expect_problems(1)  # by the second drag, so the first one is over

    evaluate("held = true")
    mouse.move(start[0] + 30, start[1] + 9)
    page.page.wait_for_function("() => kept.length > 0")
    mouse.move(*start)
    evaluate("deliver()")  # what was sent of the place before
    mouse.up()
    evaluate("held = false; deliver()")
    page.page.wait_for_function("() => sent === answered")
    assert page.middle(page.place("waypoint 20")) == pytest.approx(start, abs=1.0)


def test_zones_are_reshaped_and_a_draft_is_saved_when_that_is_confirmed(mission, open_page):
    page = open_page(mission)
    page.zone("zone 8").click()
    corner = page.page.locator(".corner").nth(0)
    keys = json.loads(corner.get_attribute("data-corner"))
    assert keys[:3] == ["no_fly_zones", 7, "polygon"]
    page.drag(page.middle(corner), page.middle(page.place("waypoint 3")))
    page.expect_problems(1)
    page.save()
    page.page.get_by_role("button", name="Keep editing").click()
    page.page.keyboard.press("Control+z")
    page.expect_problems(0)
    page.page.keyboard.press("Control+Shift+z")
    page.expect_problems(1)
    page.page.keyboard.press("Control+s")
    page.page.get_by_role("button", name="Save the draft").click()
    page.expect_saved()
    page.page.locator("#problems button").first.click()
    expect(page.page.locator("#inspector")).to_be_visible()
    assert (
        len(changes((ROOT / "missions/pennovation/mission.yaml").read_text(), mission.read_text()))
        == 2
    )


def test_what_is_done_to_places_and_zones_is_saved_each_in_its_lines(mission, open_page):
    """Corners inserted and removed, zones drawn, places by the keyboard alone, and in haste."""
    page = open_page(mission)
    keyboard, mouse = page.page.keyboard, page.page.mouse

    def saved(done):
        before = mission.read_text()
        done()
        keyboard.press("Control+s")
        if page.page.locator("#count").inner_text() != "0":
            page.page.get_by_role("button", name="Save the draft").click()
        page.expect_saved()
        return sorted(changes(before, mission.read_text()))

    def moves_and_removes():
        keyboard.press("n")
        expect(page.place("waypoint 1")).to_be_focused()
        keyboard.press("ArrowUp")
        expect(page.page.locator("#undo")).to_be_enabled()
        keyboard.press("n")
        keyboard.press("Delete")
        expect(page.place("waypoint 39")).to_have_count(0)

    assert saved(moves_and_removes) == [
        "+   - [39.9422384, -75.2001338]  # 1",
        "-   - [39.9422294, -75.2001338]  # 1",
        "-   - [39.9426945, -75.1999767]",
    ]

    def draws():
        page.zone("zone 5").click()
        corners = page.page.locator(".corner")
        expect(corners).to_have_count(4)
        page.page.locator(".middle").nth(1).click()
        expect(corners).to_have_count(5)
        corners.nth(2).click(button="right")
        expect(corners).to_have_count(4)
        keyboard.press("Escape")
        keyboard.press("z")
        for x, y in ((150, 600), (210, 600), (210, 660), (150, 660), (150, 600)):
            mouse.click(x, y)
        expect(page.zone("zone 9")).to_have_count(1)
        keyboard.press("c")
        mouse.click(150, 500)
        mouse.click(170, 500)
        expect(page.zone("zone 10")).to_have_count(1)

    drawn = saved(draws)
    assert {"+   - name: zone 9", "+   - name: zone 10"} <= set(drawn)
    assert {"+     polygon:", "+     circle:"} <= set(drawn)

    def adds_in_haste():
        keyboard.press("w")
        for x in (480, 520, 560, 600):
            mouse.click(x, 700)  # outside of the fence
        expect(page.place("waypoint 42")).to_have_count(1)

    hasty = saved(adds_in_haste)
    added = [line for line in mission.read_text().splitlines() if f"+ {line}" in hasty]
    longitudes_deg = [float(line.split(",")[1].strip(" ]")) for line in added]
    assert len(hasty) == len(added) == 4
    assert longitudes_deg == sorted(longitudes_deg)


def test_a_page_that_received_every_change_looks_like_one_opened_now(mission, open_page):
    page = open_page(mission)
    keyboard, mouse = page.page.keyboard, page.page.mouse
    page.zone("zone 5").click()
    page.drag(page.middle(page.page.locator(".corner").first), (700, 300))
    keyboard.press("Escape")
    page.zone("zone 3").click()
    keyboard.press("Delete")
    expect(page.zone("zone 3")).to_have_count(0)
    keyboard.press("n")
    keyboard.press("ArrowUp")
    for key, number in (("Delete", 38), ("Control+z", 39), ("Control+Shift+z", 38)):
        keyboard.press(key)
        expect(page.page.locator("#facts")).to_contain_text(f"{number} waypoints")
    keyboard.press("w")
    mouse.click(480, 700)
    expect(page.place("waypoint 39")).to_have_count(1)
    keyboard.press("Escape")
    page.place("waypoint 9").click()
    page.page.locator("#inspector input").fill("31")
    keyboard.press("Enter")
    expect(page.place("waypoint 9")).to_contain_text("31 m")
    page.save()
    page.page.get_by_role("button", name="Save the draft").click()
    page.expect_saved()

    def looks(each):
        each.page.evaluate("document.activeElement.blur()")
        each.page.keyboard.press("Escape")
        each.page.keyboard.press("f")
        each.page.wait_for_timeout(500)
        return each.page.evaluate(LOOKS, DRAWN)

    updated, opened = looks(page), looks(open_page(mission))
    assert len(updated) == len(opened) > 100
    for what, box in updated:
        same = [other for name, other in opened if name == what]
        assert any(box == pytest.approx(other, abs=2) for other in same), what


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)], ids=str)
def test_waypoints_are_reordered_in_the_list_by_keys_and_buttons_and_reversed(
    mission, open_page, size
):
    page = open_page(mission)
    page.page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))

    def waypoints():
        text = mission.read_text().partition("\nwaypoints:")[2].partition("\nfence:")[0]
        return [*map(json.loads, re.findall(r"(?m)^ +- (\[39[^\]]+\])", text)[:39])]

    def saved(done):
        done()
        expect(page.page.locator("#save")).to_be_enabled()
        page.save()
        if page.page.locator("#count").inner_text() != "0":
            page.page.get_by_role("button", name="Save the draft").click()
        page.expect_saved()
        return waypoints()

    first, second, third, *rest = before = waypoints()
    assert len(before) == 39
    page.page.locator("#parts summary").click()
    rows = page.page.locator("#list li.waypoint")
    expect(rows).to_have_count(39)

    def drags():
        rows.nth(0).evaluate("(row) => row.scrollIntoView({ block: 'center' })")
        top = rows.nth(0).bounding_box()
        page.drag(page.middle(rows.nth(2).locator(".grip")), (top["x"] + 40, top["y"] + 3))

    assert saved(drags) == [third, first, second, *rest]
    expect(page.place("waypoint 1")).to_have_class(re.compile("selected"))

    def presses():
        page.page.keyboard.press("PageDown")
        expect(page.place("waypoint 2")).to_have_class(re.compile("selected"))
        page.page.keyboard.press("PageDown")
        expect(page.place("waypoint 3")).to_have_class(re.compile("selected"))

    assert saved(presses) == before
    earlier = page.page.get_by_role("button", name="Earlier")
    assert saved(earlier.click) == [first, third, second, *rest]
    undo = page.page.locator("#undo")
    expect(undo).to_have_attribute("title", "Undo reorder waypoints (Ctrl+Z)")
    assert saved(undo.click) == before
    assert saved(page.page.locator("#reverse").click) == before[::-1]


@pytest.mark.parametrize("locale", ["en-US", "de-DE", "ar-EG"])
def test_a_number_is_what_was_written_or_the_user_is_prompted_again(mission, open_page, locale):
    page = open_page(mission, locale=locale)
    page.page.locator("details:has(#numbers) summary").click()
    field = page.page.get_by_label("Altitude above home, m")
    before = field.input_value()

    def write(text):
        field.fill(text)
        field.press("Enter")
        return field.evaluate("input => input.validationMessage")

    for text, reason in (
        ("1,500", '"1,500" is ambiguous: 1500 or 1.500; write one of these'),
        ("40 m", '"40 m" is not a number: write it like 40 or 40.5'),
        ("1e3", '"1e3" is not a number: write it like 40 or 40.5'),
        ("-3", '"-3" is less than 0'),
    ):
        assert write(text) == reason
    assert write("40,5") == ""
    expect(field).to_have_value("40.5")
    page.save()
    page.expect_saved()
    assert "altitude_m: 40.5" in mission.read_text()
    assert write(before) == ""
    expect(field).to_have_value(before)


@pytest.mark.parametrize("place", ["[86.0, 30.0]", "[-16.5, 180.0]"])
def test_missions_near_the_pole_and_on_the_antimeridian_fill_the_map(tmp_path, open_page, place):
    path = tmp_path / "far.yaml"
    path.write_text(
        f"coordinates: local\nframe: {{origin: {place}}}\nhome: [0, 0]\naltitude_m: 40\n"
        "waypoints: [[100, 0], [-100, 0], [0, 100], [0, -100]]\nfence: null\nno_fly_zones: []\n"
    )
    page = open_page(path)
    page.page.keyboard.press("f")
    east, west, north, south = (page.middle(page.place(f"waypoint {n}")) for n in (1, 2, 3, 4))
    assert east[0] - west[0] > 300
    assert south[1] - north[1] == pytest.approx(east[0] - west[0], rel=0.02)


def test_a_route_between_two_waypoints_is_shown_over_tiles(mission, open_page):
    tiles = around(17, 39.942, -75.2)
    write_tiles(mission.with_name("site.mbtiles"), tiles, attribution="<b>City</b> of P.")
    page = open_page(mission, "--image", mission.with_name("site.mbtiles"))
    page.page.keyboard.press("p")
    page.place("waypoint 15").click()
    page.place("waypoint 33").click()
    hint = page.page.locator("#hint")
    expect(hint).to_contain_text("15 to 33:")
    assert "closest" in hint.inner_text()
    route = page.page.locator("path.route")
    expect(route).not_to_have_attribute("d", "M0 0")

    page.page.keyboard.press("Escape")
    expect_tiles(page)
    assert page.page.locator(".leaflet-control-attribution").inner_text() == "City of P."
    page.page.wait_for_function(ENLARGE, polling=50)  # more than any tile


def test_a_change_on_the_disk_is_shown_and_a_lost_program_too(mission, open_page):
    page = open_page(mission, "--host", "127.0.0.1")
    mission.write_text(mission.read_text().replace("name: zone 3", "name: hall"))
    page.page.get_by_role("button", name="Load the file").click()
    expect(page.zone("hall")).to_have_count(1)
    gone = page.page.locator("#offline")
    expect(gone).to_be_hidden()
    page.program.interrupt()
    code, _ = page.program.finish()
    assert code == 0
    expect(gone).to_be_visible()
    page.page.context.close()
    page.faults.clear()  # that no server answers is logged on the console as well


def test_the_page_is_readable_on_a_phone(mission, open_page):
    page = open_page(mission, has_touch=True)
    page.page.set_viewport_size({"width": 390, "height": 780})
    page.page.keyboard.press("f")
    width = page.page.evaluate("document.documentElement.scrollWidth")
    assert width == 390
    panel = page.page.locator("#panel").bounding_box()
    assert panel["x"] >= 0
    assert panel["x"] + panel["width"] <= 390
    page.place("waypoint 30").tap()
    expect(page.page.locator("#inspector")).to_contain_text("Waypoint 30")


OUT_OF_REACH = """[...document.querySelectorAll("#tools button, #actions button")]
  .filter((button) => {
    const { x, y, width, height } = button.getBoundingClientRect();
    return document.elementFromPoint(x + width / 2, y + height / 2)?.closest("button") !== button;
  })
  .map((button) => button.title)"""


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (844, 390), (390, 844), (360, 640)])
def test_every_tool_is_in_reach_in_every_size(mission, open_page, width, height):
    page = open_page(mission)
    page.page.set_viewport_size({"width": width, "height": height})
    page.page.wait_for_function("width => innerWidth === width", arg=width)
    assert page.page.evaluate(OUT_OF_REACH) == []
