"""How `fly` sets out, without a vehicle."""

import dataclasses
import gc
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from air_router.cli.cli import main
from air_router.controller.model.flight_setup import FlightSetup
from air_router.errors import RefusedError
from air_router.flight.flight import Flight
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.loading import load_mission
from air_router.record.recorder import Recorder

PENNOVATION = Path(__file__).parents[3] / "missions" / "pennovation" / "mission.yaml"


def test_what_is_there_before_a_flight_is_not_searched_for_garbage_in_it(monkeypatch):
    """A search of all that is loaded blocks the flight loop for as long as 50 ms."""
    frozen = []

    async def run(_flight, _page):
        frozen.append(gc.get_freeze_count())
        raise RefusedError("enough was seen")

    monkeypatch.setattr(Flight, "run", run)
    before = gc.get_freeze_count()
    main(["fly", str(PENNOVATION), "--connect", "udpin://127.0.0.1:1", "--no-record"])
    assert frozen[0] > before


BEGAN_AGO = timedelta(minutes=30)
MARKET = """
  - name: market
    circle: {{centre: [39.94160, -75.19930], radius_m: 5}}
    active: [{{{active}}}]
"""


@pytest.fixture
def resumed(tmp_path, monkeypatch):
    """Goes on with a flight, by its record if there is one; gives the mission."""

    def go_on(active, *options, duration_s=1200.0, began_ago=BEGAN_AGO, recorded=True, uav="titan"):
        text = PENNOVATION.read_text(encoding="utf-8")
        for name in ("team", "world"):
            text = text.replace(f"{name}: ", f"{name}: {PENNOVATION.parent}/")
        market = MARKET.format(active=active)
        text = text.replace("\nno_fly_zones:\n", f"\nno_fly_zones:{market}")
        file, logs, seen = tmp_path / "mission.yaml", tmp_path / "logs", []
        file.write_text(text, encoding="utf-8")
        began = datetime.now(UTC).replace(microsecond=0) - began_ago
        before = load_mission(file, start=began, duration_s=duration_s)
        before = dataclasses.replace(before, uav=uav)
        if recorded:
            with Recorder(logs, str(file)) as recorder:
                recorder.begin(FlightSetup(before, ()), arm=True, resume=False, camera=None)
                recorder.note(Recorder.PREFLIGHT, 0.0, {})

        async def run(flight, _page):
            seen.append(flight.controller.context.airspace.mission)
            raise RefusedError("enough was seen")

        monkeypatch.setattr(Flight, "run", run)
        link = ("--connect", "udpin://127.0.0.1:1", "--log-dir", str(logs), "--resume")
        main(["fly", str(file), *link, "--duration", str(duration_s), *options])
        return before, seen[0]

    return go_on


def until_now():
    """Hours that were over ten minutes ago, but not when the flight began."""
    over = datetime.now(UTC) - timedelta(minutes=10)
    return f"from: {over - timedelta(hours=1):%Y-%m-%dT%H:%M:%SZ}, until: {over:%Y-%m-%dT%H:%M:%SZ}"


def from_soon():
    """Hours that the flight was to be over before."""
    begins = datetime.now(UTC) + timedelta(minutes=75)
    return f"from: {begins:%Y-%m-%dT%H:%M:%SZ}"


@pytest.mark.parametrize("hours", [until_now, from_soon])
def test_a_flight_is_gone_on_with_among_the_zones_that_it_began_with(resumed, hours):
    """Chosen anew, the plan on board would be another than the mission's."""
    before, mission = resumed(hours())
    assert FlightPlan.of(mission) == FlightPlan.of(before)
    assert mission.window == before.window
    assert mission.latest_start == before.latest_start  # and it is home by then


def test_a_flight_that_must_be_over_by_now_reports_nothing_of_the_zones_of_now(resumed):
    before, mission = resumed(until_now(), began_ago=timedelta(hours=3))
    assert mission.window.start > before.window.start
    assert "market" not in {zone.name for zone in mission.airspace.zones}


@pytest.mark.parametrize("other", [{"recorded": False}, {"uav": "another"}])
def test_without_a_record_of_it_zones_are_chosen_for_a_flight_from_now(resumed, other):
    before, mission = resumed(until_now(), **other)
    assert mission.window.start > before.window.start
