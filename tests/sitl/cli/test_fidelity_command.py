"""`sitl experiment fidelity`: what is counted, and what the table says of it."""

import argparse
import dataclasses
import json

import pytest

from air_router.controller.model.actions import StateChanged
from air_router.controller.model.states import Signal, State
from mocha_link.links.metrics import ContactBegan, ContactEnded, Direction, SyncEnded
from sitl.cli import fidelity_command
from sitl.cli.fidelity_command import Flown, Meter, compared, flown_in_processes, table
from sitl.experiment.events import EventQueue


def test_searches_waits_and_visits_are_counted_from_changes_of_state():
    meter = Meter(EventQueue())
    way = [
        (0.0, State.READY, State.INIT),
        (180.0, State.INIT, State.SEARCH),
        (200.0, State.SEARCH, State.COMM),
        (202.0, State.COMM, State.EXPL),
        (300.0, State.EXPL, State.SEARCH),
        (345.0, State.SEARCH, State.EXPL),  # in vain
        (400.0, State.EXPL, State.SEARCH),
        (410.0, State.SEARCH, State.COMM),
        (416.0, State.COMM, State.HOME),
    ]
    for time_s, source, target in way:
        meter.take(time_s, StateChanged(source, Signal.TIMER, target, None))
    meter.take(200.0, ContactBegan("io", 0.0, None))
    meter.take(230.0, ContactEnded("io", 0.0, 30.0, ""))
    meter.take(201.0, SyncEnded("io", 0.0, Direction.IN, 1, 10, 0.1))
    assert dataclasses.astuple(meter.flown([1_500, 500])) == (
        *(3, 2, 1, 30.0, 1, 2.0),
        *(15.0, 4.0, 416.0),
    )


@pytest.mark.parametrize(
    ("syncs", "within"),
    [((100, 101, 99), "yes"), ((150, 151, 149), "no"), ((60, 100, 150), "open")],
)
def test_what_is_within_a_tenth_is_said_by_the_interval_of_the_ratio(syncs, within):
    def flights(numbers):
        ones = {each.name: 1.0 for each in dataclasses.fields(Flown)}
        return [Flown(**ones | {"syncs": number}) for number in numbers]

    rows = {row["name"]: row for row in compared(flights(syncs), flights((100, 100, 100)))}
    assert rows["syncs"]["within"] == within
    assert rows["syncs"]["low"] <= rows["syncs"]["ratio"] <= rows["syncs"]["high"]
    assert rows["syncs"]["ratio"] == pytest.approx(sum(syncs) / 300)
    assert rows["found"]["within"] == "yes"
    # Fading that both sides meet alike is no doubt about their ratio.
    (alike,) = [r for r in compared(flights(syncs), flights(syncs)) if r["name"] == "syncs"]
    assert (alike["low"], alike["ratio"], alike["high"]) == (1.0, 1.0, 1.0)
    assert f"| `syncs` | {sum(syncs) / 3:.1f} | 100.0 |" in table(rows.values())


def test_what_has_been_flown_is_not_flown_again(tmp_path, monkeypatch, capsys):
    flown = Flown(**{each.name: 1.0 for each in dataclasses.fields(Flown)})
    for seed in (1, 2):
        folder = tmp_path / f"seed-{seed}"
        folder.mkdir()
        (folder / "counts.json").write_text(json.dumps(dataclasses.asdict(flown)))
    assert flown_in_processes(tmp_path / "no such mission.yaml", 1, tmp_path) == flown
    monkeypatch.setattr(fidelity_command, "flown_here", lambda *_: flown)
    told = argparse.Namespace(out=tmp_path, seeds=2, json=True)
    assert fidelity_command.run(told) == 0
    assert {row["within"] for row in json.loads(capsys.readouterr().out)} == {"yes"}
