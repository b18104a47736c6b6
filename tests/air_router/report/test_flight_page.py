"""The page of a flight: what a reader sees in it, and that it needs and believes nothing."""

import colorsys
import dataclasses
import html
import html.parser
import itertools
import json
import re
import xml.etree.ElementTree as ET

import pytest

from air_router.cli.cli import main
from air_router.controller.model.actions import Announce
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.states import State
from air_router.record.log import RecordEntry
from air_router.record.recorder import Recorder
from tests.air_router.report.flown import UNIX_S, entries, recorded, things

HOSTILE = "<script>alert('io')</script>"
FIGURES = ("track", "timeline", "bandwidth", "ages", "map", "distance", "battery")


@pytest.fixture(scope="module")
def page_of():
    """With matplotlib, which the workers that only collect these tests do without."""
    from air_router.report.flight_page import page_of  # noqa: PLC0415

    return page_of


@pytest.fixture(scope="module")
def colours():
    from air_router.report.figure_style import colours  # noqa: PLC0415

    return colours


@pytest.fixture(scope="module")
def history(pennovation):
    return recorded(entries(pennovation))


@pytest.fixture(scope="module")
def text(page_of, history):
    return page_of(history, "a.mcap")


class Page(html.parser.HTMLParser):
    """What a browser makes of a page: its tags, what it leads to, and the text of each section."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.links, self.ids, self.tiles = [], [], [], {}
        self.sections = {}  # all texts below a heading, SVG included
        self._heading, self._text, self._open = "", [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        given = dict(attributes)
        self.links += [given[name] for name in ("src", "href", "action") if name in given]
        self.ids += [given["id"]] if "id" in given else []
        self._open.append(tag)
        if tag in {"span", "b", "small"}:
            self._text.append("")
        if tag == "footer":
            self._heading = ""

    def handle_endtag(self, tag):
        if tag == "small":
            name, value, more = self._text
            self.tiles[name], self._text = (value, more), []
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data):
        words = data.strip()
        if not words:
            return
        if "h2" in self._open:
            self._heading = words
            self.sections[words] = []
        elif self._heading:
            self.sections[self._heading].append(words)
        if self._open and self._open[-1] in {"span", "b", "small"}:
            self._text[-1] += words


def pictures(text, name):
    """The SVGs of a figure as elements, the wide one first."""
    section = text.partition(f'<section id="{name}">')[2].partition("</section>")[0]
    found = re.findall(r"<svg.*?</svg>", section, re.DOTALL)
    return [ET.fromstring(svg) for svg in found]  # noqa: S314 - our own


def words_in(picture):
    return ["".join(text.itertext()) for text in picture.iter("text")]


def tooltips(picture):
    return [title.text for title in picture.iter("title")]


# What is on it.


def test_the_flight_in_a_few_numbers(text):
    page = Page(text)
    assert page.tiles == {
        "outcome": ("completed", ""),
        "flight time": ("1:15", "118 m flown"),
        "closest approach": ("4.0 m", "to new; required 5 m"),
        "syncs completed": ("66.7%", "2 of 3 started"),
        "data exchanged": ("94 kB", "4000 B received, 90 kB sent"),
        "battery used": ("29%", "from 95% to 66%"),
    }


@pytest.mark.parametrize(
    ("outcome", "reason", "shown"),
    [
        ("done", "the page's request", ("completed", "returned at the page's request")),
        ("done", "my planner's request", ("completed", "returned at my planner's request")),
        ("pilot", None, ("pilot took over", None)),
        ("failsafe", None, ("autopilot failsafe", None)),
        ("ended: no way home", "battery at 25%", ("ended: no way home", "battery at 25%")),
    ],
)
def test_how_it_ended_is_shown_as_text(page_of, history, outcome, reason, shown):
    report = {"outcome": outcome, "came_home_because": reason}
    text = page_of(dataclasses.replace(history, report=report), "a.mcap")
    value, more = shown
    tile = text.partition("<span>outcome</span>")[2].partition("</li>")[0]
    assert f"<b>{value}</b>" in tile
    assert f"<small>{more or ''}</small>" in html.unescape(tile)


def test_a_breach_of_the_clearance_stands_out(page_of, history):
    assert '<li class="bad"><span>closest approach</span>' in page_of(history, "a")
    fine = dataclasses.replace(history, closest=(5.0, "new"))
    assert 'class="bad"' not in page_of(fine, "a")
    free = dataclasses.replace(history, closest=None, closest_at=None)
    assert Page(page_of(free, "a")).tiles["closest approach"] == ("none", "no zones, no fence")


def test_announcements_and_actions_are_in_tables(text):
    page = Page(text)
    robots = page.sections["Robots"]
    at = robots.index("io")
    assert robots[at : at + 8] == ["io", "0", "1, 0:07", "1 of 1", "1 of 2", "94 kB", "53 s", "38%"]
    assert robots[robots.index("phantom") + 6] == "never received"
    assert page.sections["Why the mission waited"][4:] == [
        *("GPS has no fix", "INPUT_MISSING", "2", "4.5 s"),
        *("zones are being changed", "ZONE_UPDATE", "1", "0.5 s"),
    ]
    requests = page.sections["Requests"]
    assert requests[4:8] == ["0:32", "seek io", "kim", "accepted: seeking"]
    assert "refused: in a zone" in requests
    assert requests[-1] == "no answer recorded"
    assert page.sections["Announcements"][-3:] == ["0:30", "info", "SEARCH io: where its path ends"]
    assert page.sections["Commands not followed"][-2:] == ["0:40", "FlyToNode: it was canceled"]


def test_a_table_without_rows_is_left_out(page_of, pennovation):
    quiet = recorded([e for e in entries(pennovation) if e.kind != "action" or e.t == 10.0])
    page = Page(page_of(quiet, "a.mcap"))
    assert "Requests" in page.sections
    assert not {"Announcements", "Why the mission waited"} & page.sections.keys()


def test_every_figure_is_there_for_a_screen_and_for_a_phone(text):
    for name in FIGURES:
        wide, narrow = pictures(text, name)
        assert (wide.get("class"), narrow.get("class")) == ("wide", "narrow")
        assert wide.get("aria-label") == narrow.get("aria-label") != ""
        for picture in (wide, narrow):
            assert words_in(picture)
            drawn = " ".join(part.get("d", "") for part in picture.iter())
            assert "nan" not in drawn
            assert "inf" not in drawn


@pytest.mark.parametrize(
    ("name", "unit", "values"),
    [
        ("bandwidth", "kB/s", ["0", "50"]),
        ("ages", "s", ["0", "20", "40"]),
        ("map", "%", ["0", "25", "50", "75", "100"]),
        ("distance", "m", ["0", "20", "40"]),
        ("battery", "%", ["0", "25", "50", "75", "100"]),
    ],
)
def test_axes_have_units_and_values(text, name, unit, values):
    for picture in pictures(text, name):
        words = words_in(picture)
        assert unit in words
        assert "elapsed time, min:s" in words
        assert {*values, "0:00"} <= {*words}


def test_what_is_named_in_figures(text):
    for picture in pictures(text, "track"):
        assert {"metres east", "metres north", "N", "io", "new"} <= {*words_in(picture)}
        assert {"flown track", "no-fly zone", "closest approach", "home"} <= {*words_in(picture)}
        assert "io, reported at 0:28" in tooltips(picture)
        assert "waypoint 1" in tooltips(picture)
    wide, narrow = pictures(text, "timeline")
    assert {"mission", "io", "phantom", "INIT", "SEARCH io", "HOME"} <= {*words_in(wide)}
    for picture in (wide, narrow):
        assert "SEARCH io, 0:30: the state's timer expired" in tooltips(picture)
        assert "io in range for 0:07" in tooltips(picture)
        assert "sync from io, complete: 3 messages, 4,000 bytes" in tooltips(picture)
        assert "sync to io, broken off: 0 messages, 0 bytes" in tooltips(picture)
    assert "0:21: 2.0 kB/s in" in tooltips(pictures(text, "bandwidth")[0])
    assert "clearance 5 m" in words_in(pictures(text, "distance")[0])
    page = Page(text)
    assert {"READY", "INIT", "sync completed", "sync lost", "in range"} <= {
        *page.sections["States, contacts and syncs"]
    }
    assert page.sections["Map coverage"][0].startswith("Share of the 8,000 cells")


def test_the_legend_of_the_map_names_what_is_there(page_of, pennovation):
    begun = [*itertools.islice(entries(pennovation.with_areas(pennovation.fences, ())), 5)]
    (words, _) = map(words_in, pictures(page_of(recorded(begun), "a.mcap"), "track"))
    assert "fence" in words
    assert not {"no-fly zone", "closest approach", "flown track", "io"} & {*words}


@pytest.mark.parametrize(
    ("away_m", "top_m"), [([7.0, 45.0], 45.0), ([7.0, 90.0], 60.0), ([95.0, 120.0], 120.0)]
)
def test_distances_are_drawn_as_they_are(page_of, history, away_m, top_m):
    distances = tuple((float(t), m) for t, m in enumerate(away_m))
    text = page_of(dataclasses.replace(history, distances=distances), "a.mcap")
    wide, _ = pictures(text, "distance")
    ticks = {}  # pixels by metres: numbers at the left stand at their lines
    for label in wide.iter("text"):
        if re.fullmatch(r"\d+", label.text or ""):
            ticks[float(label.text)] = float(label.get("y"))
    (low, low_y), *_, (high, high_y) = sorted(ticks.items())
    (line,) = [
        part.get("d")
        for part in wide.iter("path")
        if "stroke: var(--accent)" in part.get("style", "")
    ]
    (_, y1), (_, y2) = re.findall(r"([\d.]+) ([\d.]+)", line)
    risen_m = (float(y1) - float(y2)) * (high - low) / (low_y - high_y)
    assert risen_m == pytest.approx(min(away_m[1], top_m) - away_m[0], abs=0.5)
    assert ("Distances above" in text) == (max(away_m) > top_m)


def test_a_flight_of_one_moment_has_a_page(page_of, pennovation):
    history = recorded([*itertools.islice(entries(pennovation), 5)], "it was cut off")
    text = page_of(history, "a.mcap")
    assert len(pictures(text, "timeline")) == 2
    assert pictures(text, "bandwidth") == []


def test_long_flights_have_few_times_on_their_axes(page_of, history):
    for span_s in (61.0, 2e5, 1e9):
        text = page_of(dataclasses.replace(history, to_s=history.from_s + span_s), "a.mcap")
        for picture, most in zip(pictures(text, "battery"), (11, 6), strict=True):
            times = [words for words in words_in(picture) if re.fullmatch(r"[\d:]+:\d\d", words)]
            assert 2 <= len(times) <= most


def test_long_lines_keep_their_extremes_and_lose_points(page_of, history):
    series = tuple((t / 100, 20.0 + (15.0 if t == 3_333 else t % 2)) for t in range(8_000))
    text = page_of(dataclasses.replace(history, distances=series), "a.mcap")
    wide, _ = pictures(text, "distance")
    (line,) = [
        part.get("d")
        for part in wide.iter("path")
        if "stroke: var(--accent)" in part.get("style", "")
    ]
    heights = [float(y) for _, y in re.findall(r"([\d.]+) ([\d.]+)", line)]
    assert len(heights) < 4_500
    spike, *others = sorted(set(heights))
    assert others[0] - spike > 20  # pixels


# What it needs: nothing.


def test_the_page_needs_nothing(text):
    page = Page(text)
    assert not {"script", "link", "img", "iframe", "object"} & {*page.tags}
    assert "http" not in text
    assert "@import" not in text
    assert {link[0] for link in page.links} == {"#"}
    assert {*re.findall(r"url\((.)", text)} <= {"#"}


def test_ids_are_had_once_and_lead_somewhere(text):
    page = Page(text)
    assert len(page.ids) == len({*page.ids})
    used = {link.removeprefix("#") for link in page.links} | {*re.findall(r"url\(#([^)]+)", text)}
    assert used <= {*page.ids}


def test_the_same_record_gives_the_same_bytes(page_of, pennovation):
    pages = {page_of(recorded(entries(pennovation)), "a.mcap") for _ in range(2)}
    assert len(pages) == 1


# What it believes: nothing.


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        (HOSTILE, HOSTILE),
        ("a&b \"c\" 'd'", "a&b \"c\" 'd'"),
        ("$x_1$ and $", "$x_1$ and $"),
        ("\u202eevil\x00\x1b[2J", "?evil??[2J"),
        ("木星 🛰", "木星 🛰"),
        ("{{ 7 * 7 }}{% raw %}", "{{ 7 * 7 }}{% raw %}"),
        ("", ""),
    ],
)
def test_names_of_others_are_text(page_of, pennovation, name, shown):
    zones = tuple(dataclasses.replace(zone, name=name) for zone in pennovation.zones)
    mission = dataclasses.replace(pennovation, name=name, zones=zones)
    announced = [RecordEntry(40.0, "action", Announce(name))]
    text = page_of(recorded([*entries(mission, name), *announced], name), name)
    page = Page(text)
    assert {"script", "49"} & {*page.tags, *page.sections["Robots"]} == set()
    assert "\x00" not in text
    assert "\u202e" not in text
    for figure in FIGURES:
        assert len(pictures(text, figure)) == 2
    if shown:
        assert shown in page.sections["Robots"]
        assert shown in page.sections["Announcements"]
        assert shown in words_in(pictures(text, "track")[0])


def test_of_a_record_that_is_cut_off_the_page_has_that(page_of, pennovation):
    text = page_of(recorded(entries(pennovation), "it was <cut> off"), "a.mcap")
    assert "The record is incomplete: it was &lt;cut&gt; off." in text


def test_a_vehicle_may_have_begun_at_no_time(page_of, history):
    for unix_s in (None, 1e300, -1e300):
        strange = dataclasses.replace(history, unix_offset_s=unix_s)
        assert "UTC" not in page_of(strange, "a.mcap")
    assert "2023-11-14 22:13 UTC" in page_of(history, "a.mcap")


# Colours.


def luminance(colour):
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_figures_have_the_page_s_colours_and_no_others(text, colours):
    for name in FIGURES:
        for picture in pictures(text, name):
            drawn = ET.tostring(picture, encoding="unicode")
            assert re.findall(r"#[0-9a-f]{6}\b", drawn) == []
            assert {*re.findall(r"var\(--([\w-]+)\)", drawn)} <= colours().keys()
    defined = {*re.findall(r"--([\w-]+):", text.partition("</style>")[0]), "is"}
    assert {*re.findall(r"var\(--([\w-]+)", text)} <= defined


def test_colours_that_look_alike_in_the_light_do_in_the_dark(colours):
    """In a figure they cannot be told apart: it is drawn in the light ones."""
    light, dark = colours(), colours(dark=True)
    assert light.keys() == dark.keys()
    pairs = {(light[name], dark[name]) for name in light}
    assert len(pairs) == len({*light.values()})


@pytest.mark.parametrize("is_dark", [False, True])
def test_figures_can_be_read(colours, is_dark):
    from air_router.report.charts import STATE_COLOURS  # noqa: PLC0415

    shades, card = colours(dark=is_dark), "#212b35" if is_dark else "#ffffff"
    for words in ("ink", "soft"):
        assert contrast(shades[words], card) >= 4.5
        assert contrast(shades["ink"], shades["ground"]) >= 4.5
    assert contrast(shades["zone-name"], shades["zone-fill"]) >= 4.5
    assert {*STATE_COLOURS} == {*State}
    for colour in STATE_COLOURS.values():  # large and bold
        assert contrast(shades["on-state"], shades[colour]) >= 3
    for number in range(8):
        assert contrast(shades[f"r{number}"], card) >= 3
    hues = {colorsys.rgb_to_hls(*bytes.fromhex(shades[f"r{n}"][1:])) for n in range(8)}
    assert len(hues) == 8


# The command.


@pytest.fixture
def record(pennovation, tmp_path):
    with Recorder(tmp_path, "m", unix_s=lambda: UNIX_S) as recorder:
        recorder.begin(FlightSetup(pennovation, ("io",), name="titan"))
        for t, value in things():
            if type(value).__module__.endswith("actions"):
                recorder.actions((value,), t)
            else:
                recorder.event(value, t)
    return recorder.path


def test_the_command_writes_a_page_beside_the_record(record, capsys):
    assert main(["report", str(record)]) == 0
    page = record.with_suffix(".html")
    assert capsys.readouterr().err == f"the report: {page}\n"
    assert page.read_text("utf-8").startswith("<!doctype html>")
    page.unlink()
    before = record.read_bytes()
    assert main(["report", str(record), "-o", str(record)]) == 2
    assert "is the record itself" in capsys.readouterr().err
    assert record.read_bytes() == before
    assert main(["report", str(record), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["uav"] == "titan"
    assert not page.exists()


def test_a_record_with_any_name_has_a_page(record, tmp_path):
    odd = tmp_path / "b\udcff.mcap"  # bytes that are no UTF-8
    odd.write_bytes(record.read_bytes())
    assert main(["report", str(odd)]) == 0
    assert "Made from b?.mcap." in odd.with_suffix(".html").read_text("utf-8")


def test_a_record_that_is_none_is_reported(tmp_path, capsys):
    none = tmp_path / "none.mcap"
    none.write_text("no record")
    assert main(["report", str(none)]) == 3
    assert str(none) in capsys.readouterr().err
    assert not none.with_suffix(".html").exists()
