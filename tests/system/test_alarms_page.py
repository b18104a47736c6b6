"""Alarms on the live page, as a person sees and hears them: on a laptop and on a phone."""

import pytest

from air_router.controller.model.actions import Announce
from air_router.controller.model.flight_setup import FlightSetup
from air_router.editor.session import write_starter
from air_router.live.playback import RecordedFlight
from air_router.live.server import LivePage
from air_router.mission.loading import load_mission
from air_router.record.log import RecordEntry
from air_router.vehicle.instructions import BE_READY, FLY_OUT, Severity
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point
from tests.system.looker import Looker, expect, served
from tests.system.page_checks import CROWDED, PALE
from tests.system.test_map_pages import HOME, SIZES, Refusing, viewport

BREACH = Announce("hands off: breach of zone 3", Severity.ALARM, FLY_OUT)
NEAR = Announce("too near to zone 3: 3.1 m, 5 m are required", Severity.WARNING, BE_READY)
SOUNDED = "() => Number(document.getElementById('alarms').dataset.sounded ?? 0) > 0"


@pytest.fixture
def shown(browser, tmp_path):
    """A page of a vehicle in the air, and how to announce something on it."""
    path = tmp_path / "field.yaml"
    write_starter(path, HOME)
    mission = load_mission(path)
    telemetry = Telemetry(1.0, Point(0, 0), 40.0, armed=True, in_air=True, mode=FlightMode.MISSION)
    setup = RecordEntry(0.0, "setup", FlightSetup(mission, ("io",)))
    film = RecordedFlight([setup, RecordEntry(1.0, "event", telemetry)])
    page = LivePage(film.status, film.router, Refusing(), mapper=film.mapper)
    film.go_on(2.0, page, 10)
    with served(page) as (address, _):
        looker = Looker(browser.new_page(), address)
        looker.page.locator("path.area.fence").first.wait_for()
        yield looker, lambda *announced: page.step(None, announced, 2.0)
        assert looker.faults == []
        looker.page.close()


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_an_alarm_cannot_be_missed_and_covers_nothing(shown, size):
    looker, announce = shown
    page = looker.page
    page.set_viewport_size(viewport(size))
    expect(page.locator("#alarms")).to_be_hidden()
    announce(NEAR, BREACH)
    alarm, warning = page.locator("#alarms [role=alert]"), page.locator("#alarms [role=status]")
    expect(alarm).to_contain_text(f"ALARM{BREACH.text}. {FLY_OUT}")  # in text, not colour alone
    expect(warning).to_contain_text(f"Warning{NEAR.text}. {BE_READY}")
    expect(page.locator("#log .alarm")).to_contain_text("ALARM: ")
    expect(page.locator("#log .warning")).to_contain_text("Warning: ")
    for theme in ("light", "dark"):
        page.evaluate("(theme) => { document.documentElement.dataset.theme = theme; }", theme)
        assert page.evaluate(CROWDED) == []
        assert page.evaluate(PALE) == []
    box = alarm.bounding_box()
    assert box["x"] >= 0
    assert box["y"] >= 0
    assert box["x"] + box["width"] <= size[0]
    assert box["y"] + box["height"] <= size[1]
    expect(page.locator("#sound")).to_be_in_viewport()
    assert page.locator("body.alarmed").count() == 1


def test_an_alarm_sounds_once_a_person_has_touched_the_page_and_until_it_is_acknowledged(shown):
    looker, announce = shown
    page = looker.page
    announce(BREACH)
    expect(page.locator("#sound")).to_contain_text("Sound is off")
    assert page.evaluate(SOUNDED) is False
    page.keyboard.press("Shift")
    expect(page.locator("#sound")).to_be_empty()
    page.wait_for_function(SOUNDED)
    page.locator("#alarms button").click()
    expect(page.locator("#alarms")).to_be_hidden()
    assert page.locator("body.alarmed").count() == 0
    expect(page.locator("#log .alarm")).to_have_count(1)  # what was announced stays
    announce(BREACH)  # again: it is to be seen again
    expect(page.locator("#alarms [role=alert]")).to_have_count(1)


def test_what_is_over_is_shown_no_longer(shown):
    looker, announce = shown
    page = looker.page
    announce(Announce("position not received", Severity.ALARM, FLY_OUT, "position"))
    expect(page.locator("#log .alarm")).to_have_count(1)
    expect(page.locator("#alarms")).to_be_hidden()  # the controller does not know of it


def test_what_comes_again_and_again_is_one_line_with_a_count_but_each_alarm_has_its_own(shown):
    looker, announce = shown
    page = looker.page
    for _ in range(4):
        announce(Announce("searching"), NEAR)
        announce(Announce("talking"))
    announce(*4 * [BREACH])
    lines = page.locator("#log li")
    expect(lines.filter(has_text="talking")).to_have_text("2 s talking again 3 times")
    expect(lines.filter(has_text="searching")).to_have_text("2 s searching again 3 times")
    expect(lines.filter(has_text=NEAR.text)).to_have_count(1)
    expect(lines.filter(has_text=NEAR.text)).to_contain_text("Warning: too near")
    expect(lines.filter(has_text=BREACH.text)).to_have_count(4)
    texts = lines.all_inner_texts()
    page.reload()  # a page that is opened later shows the same
    expect(lines).to_have_count(len(texts))
    assert lines.all_inner_texts() == texts
