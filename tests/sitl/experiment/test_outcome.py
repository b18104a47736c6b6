"""Policies compared over scenarios, and what may end such a campaign."""

import json
import math
from datetime import UTC, datetime, timedelta
from pathlib import Path

import made_up
import numpy as np
import pytest

from mocha_link.team import Document
from sitl.experiment.analysis.figures import draw_outcome
from sitl.experiment.analysis.outcome import OUTCOMES, Scenarios, is_of_scenarios, standings, strata
from sitl.experiment.analysis.outcome import outcome_text as table
from sitl.experiment.analysis.report import Report
from sitl.experiment.analysis.statistics import contrast, power
from sitl.experiment.campaign.campaign import Campaign, make_runs
from sitl.experiment.campaign.journal import Journal, StopClock
from sitl.experiment.plan import StopRule
from sitl.experiment.plan_file import experiment_of, load_experiment

FILE = """
name: missions
title: Policies over scenarios
seeds: 8
settings: {duration_s: 600}
rows:
  - {label: in turn}
  - {label: never, passive: true}
  - {label: over several, policy: tour}
space:
  radius_m: {low: 5, high: 40, log: true}
  battery: [none, 20]
relevant: 2
"""


def experiment(text=FILE):
    return experiment_of(Document.from_text(text, Path("missions.yaml")))


def records_of(plan, values, numbers=range(8)):
    """A run of every row and scenario, with values of the primary outcome by row and number."""
    found = []
    for task in plan.tasks(numbers):
        record = made_up.work(task)
        own = {"goal_value_percent": float(values(task.row.label, task.number))}
        measures = {**record["measures"], **own, "service_age_mean_s": 100.0 + task.number}
        found.append({**record, "measures": measures})
    return found


def value(label, number):
    """Scenarios differ by far more than policies do."""
    return 10.0 * number + {"in turn": 0.0, "never": -2.0, "over several": 1.0}[label]


def test_every_seed_number_is_a_scenario_that_all_policies_meet():
    plan = experiment()
    tasks = [plan.task(row, 3) for row in plan.rows]
    assert len({task.seed for task in tasks}) == 1
    drawn = {(task.row.settings["radius_m"], task.row.settings["battery"]) for task in tasks}
    assert len(drawn) == 1
    assert len({plan.task(plan.rows[0], n).row.settings["radius_m"] for n in range(8)}) == 8
    assert is_of_scenarios(plan)
    apart = FILE.replace("- {label: never, passive", "- {label: never, ugvs: 5, passive")
    assert not is_of_scenarios(experiment(apart))  # rows of another seed are other scenarios


def test_policies_are_compared_scenario_by_scenario():
    plan = experiment()
    found = Scenarios(plan, records_of(plan, value))
    never, tour = (found.effect(row, OUTCOMES[0]) for row in found.rows[1:])
    assert (never.value, tour.value) == pytest.approx((-2.0, 1.0))
    assert max(never.error, tour.error) < 1e-9  # the scenarios' own differences cancel out
    assert found.effect(found.rows[1], OUTCOMES[-1]).value == 0.0  # factors are logarithms


def test_a_scenario_counts_only_if_every_policy_has_met_it():
    plan = experiment()
    records = records_of(plan, value)
    assert Scenarios(plan, records[:-1]).numbers == list(range(7))
    assert Report(plan, records[:4]).scenarios is None  # one is none


def test_tables_show_how_often_a_policy_was_better_and_what_would_have_been_seen():
    plan = experiment()
    noise = np.random.default_rng(1).normal(0, 1, 8)

    def noisy(label, number):
        return value(label, number) + noise[number] * (label == "over several")

    found = Scenarios(plan, records_of(plan, noisy))
    heads, base, never, tour = standings(found)
    assert base[0] == "in turn"
    assert never[heads.index("better in")] == "0 of 8"
    effect = found.effect(found.rows[2], OUTCOMES[0])
    assert tour[heads.index("detectable")] == f"{effect.detectable():.2f}"
    text = table(found, 2.0).splitlines()
    assert text[0].endswith("power for 2 |")
    assert text[-1].startswith("| over several |")
    assert text[-1].endswith(f"| {power(effect, 2.0):.2f} |")
    assert draw_outcome(plan, records_of(plan, noisy)) is not None


def test_drawn_settings_are_looked_at_one_at_a_time():
    plan = experiment()
    found = Scenarios(plan, records_of(plan, value))
    halves = found.levels("radius_m")
    assert [int(marks.sum()) for marks in halves.values()] == [4, 4]
    assert set(found.levels("battery")) <= {"none", "20"}
    lines = strata(found, ["radius_m"])
    assert lines[0][3:] == ["never", "over several"]
    assert lines[1][3].startswith("-2.0")


def test_power_is_the_chance_that_an_interval_excludes_nothing():
    chance = np.random.default_rng(4)
    samples = chance.normal(1.0, 2.0, (4000, 12))
    excluded = [not (e.low < 0 < e.high) for e in (contrast([s]).interval() for s in samples)]
    effect = contrast([samples[0] * (2.0 / samples[0].std(ddof=1))])
    assert power(effect, 1.0) == pytest.approx(np.mean(excluded), abs=0.03)
    assert math.isnan(power(contrast([np.ones(5)]), 1.0))


def test_a_clock_ends_a_campaign_between_scenarios_and_nothing_else_does():
    noon = datetime(2026, 11, 29, 12, tzinfo=UTC)
    plan = experiment(FILE + "stop: {begin_before: 2026-11-29T12:00:00Z}\nconfirmation_seed: 100\n")
    assert plan.rules != experiment().rules
    assert Campaign(plan, plan.rows, range(3), [], Path()).stop is None  # exploration
    assert Campaign(plan, plan.rows, range(100, 103), [], Path()).stop == plan.stop
    times = iter([noon - timedelta(seconds=1), noon, noon, noon])
    clock = StopClock(plan.stop, (), lambda: next(times))
    tasks = list(plan.tasks(range(100, 102)))
    assert [clock.may_begin(task) for task in tasks[:3]] == [True] * 3
    assert not clock.stopped
    assert not clock.may_begin(tasks[3])
    assert clock.stopped
    late = StopClock(StopRule(begin_before=noon), {101}, lambda: noon)
    assert [task.number for task in tasks if late.may_begin(task)] == [101] * 3
    assert all(map(StopClock(None, ()).may_begin, tasks))


def test_runs_that_may_not_begin_are_left_out():
    tasks = list(experiment().tasks(range(2)))
    made = make_runs(print, tasks, 2, lambda _task: False)
    assert list(made) == []


def test_the_journal_has_a_time_stamp_for_everything_that_is_done(tmp_path):
    moment = datetime(2026, 11, 29, 12, 30, 5, 999, tzinfo=UTC)
    journal = Journal(tmp_path, lambda: moment)
    journal.note("begun", declaration="ab", seeds=[1, 2])
    journal.note("stopped", by="clock")
    lines = (tmp_path / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    assert json.loads(lines[0]) == {
        "at": "2026-11-29T12:30:05Z",
        "event": "begun",
        "declaration": "ab",
        "seeds": [1, 2],
    }
    assert json.loads(lines[1])["by"] == "clock"


def test_every_run_has_the_hash_of_the_file_that_declared_it(tmp_path):
    path = tmp_path / "missions.yaml"
    path.write_text(FILE, encoding="utf-8")
    plan, _ = load_experiment(str(path))
    record = made_up.work(plan.task(plan.rows[0], 0))
    assert len(record["declaration"]) == 64
    path.write_text(FILE + "# a comment more\n", encoding="utf-8")
    again, _ = load_experiment(str(path))
    assert again.declaration != plan.declaration
    assert again.rules == plan.rules
