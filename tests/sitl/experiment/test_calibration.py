"""Settings that runs draw, a fit that finds those of a table, and what it predicts elsewhere."""

import csv
import math
import random
from pathlib import Path

import numpy as np
import pytest

from mocha_link.team.document import DocumentError
from sitl.experiment.analysis import calibration
from sitl.experiment.analysis.calibration import DRAWS, Prediction, pooled
from sitl.experiment.analysis.report import Report
from sitl.experiment.analysis.tables import PAPER_TABLE, paper_row
from sitl.experiment.campaign.running import settings_of
from sitl.experiment.plan import flat, value_text
from sitl.experiment.plan_file import load_experiment

DRAWN = Path(__file__).parents[3] / "docs" / "evidence" / "calibration-draws.csv"
WAITS = ("wait", "data_wait", "header_wait", "delay", "data_delay", "header_delay")


def made_up(task, wait="delay"):
    """The paper's numbers where robots make 0.3 of their speed, and its waits are delays."""
    chance = random.Random(task.seed)
    row, explorer = paper_row(task.row.settings), task.row.settings["explorer"]
    faster = math.log(explorer["progress"] / 0.3)
    measures = {
        "goals_found_percent": row.goals_percent + 20 * faster + chance.gauss(0, 3),
        "time_to_goal_mean_min": row.mean_time_min
        * math.exp(-0.4 * faster + 0.8 * (explorer["stuck"] - 0.25) + chance.gauss(0, 0.05)),
        "cpu_s": 1.0,
    }
    for name in WAITS:
        factor = math.exp(chance.gauss(0, 0.1)) * (1 if name == wait else 20)
        measures |= {f"{name}_mean_s": row.wait_mean_s * factor}
        measures |= {f"{name}_sd_s": row.wait_sd_s * factor}
    return {
        **task.identity,
        "rules": task.rules,
        "program": "made up",
        "settings": dict(task.row.settings),
        "measures": measures,
        "curves": {},
    }


def test_a_run_draws_its_settings_by_its_seed():
    experiment, _ = load_experiment("calibration")
    tasks = list(experiment.tasks(range(experiment.seeds)))
    assert tasks == list(experiment.tasks(range(experiment.seeds)))
    explorers = [settings_of(task).explorer for task in tasks]
    assert len({task.row.fingerprint for task in tasks}) == len(tasks) == 288
    for key in ("progress", "recognition_m", "recall", "located", "stuck"):
        prior = experiment.space[f"explorer.{key}"]
        values = sorted(getattr(explorer, key) for explorer in explorers)
        assert prior.low <= values[0] < values[-1] <= prior.high
        middle = math.sqrt(prior.low * prior.high) if prior.log else (prior.low + prior.high) / 2
        assert values[144] == pytest.approx(middle, rel=0.15)
    waits = [task.row.settings["message_wait"] for task in tasks]
    assert all(25 < waits.count(wait) < 75 for wait in WAITS)


def test_a_space_is_of_settings(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text(
        "name: a\ntitle: b\ncross: {uavs: [1, 2]}\nspace:\n"
        "  explorer.progress: {low: 0.1, high: 1.5}\n  explorer.pace: [1]\n  idle: [return]\n",
        encoding="utf-8",
    )
    with pytest.raises(DocumentError) as caught:
        load_experiment(str(path))
    assert [problem.line for problem in caught.value.problems] == [5, 6, 7]


def test_the_declared_space_has_the_hash_that_its_runs_keep():
    experiment, _ = load_experiment("calibration")
    assert experiment.rules == "e7e436e9463b"
    assert load_experiment("table1")[0].rules == "2bdf59cbffd1"


def test_settings_that_make_the_papers_table_are_found(monkeypatch):
    """As many of those drawn are kept as ever, of a fifth."""
    for name in ("_DRAWN", "_KEPT"):
        monkeypatch.setattr(calibration, name, getattr(calibration, name) // 5)
    experiment, _ = load_experiment("calibration")
    records = [made_up(task) for task in experiment.tasks(range(30))]
    fitted = Report(experiment, records)
    kept = fitted.calibration.kept
    progress, stuck = (
        np.quantile([own[f"explorer.{key}"] for own in kept], (0.05, 0.5, 0.95))
        for key in ("progress", "stuck")
    )
    assert progress == pytest.approx([0.3] * 3, rel=0.3)
    assert stuck[1] == pytest.approx(0.25, abs=0.1)
    assert {own["message_wait"] for own in kept} == {"delay"}
    located = [own["explorer.located"] for own in kept]
    assert max(located) - min(located) > 0.4  # nothing determines it
    assert len(fitted.calibration.draws) == DRAWS
    assert "| goals % | 0.88 | 1.00 |" in fitted.calibration.text()


def test_runs_of_a_row_are_pooled_as_the_paper_pools_them():
    runs = np.array([[40, 2.0, 1.0, 3.0], [60, 4.0, 3.0, 4.0], [80, math.nan, 2.0, 5.0]])
    found = pooled(np.concatenate([runs[:, :1], np.log(runs[:, 1:])], axis=1))
    assert found[0] == 60
    assert np.exp(found[1:]) == pytest.approx([3.0, 2.0, math.sqrt(50 / 3)])


def predicted(shift, spread, draws=DRAWS):
    """Runs of the rows of 10 m and 20 m that lie so many standard deviations beside the paper."""
    records = []
    for row in (row for row in PAPER_TABLE if row.radius_m in {10, 20}):
        team = {"radius_m": row.radius_m, "uavs": int(row.uavs), "ugvs": int(row.ugvs)}
        for draw in range(draws):
            away = shift + spread * math.sqrt(2) * math.cos(2 * math.pi * draw / draws)
            measures = {"goals_found_percent": row.goals_percent + 10 * away}
            measures["time_to_goal_mean_min"] = row.mean_time_min * math.exp(0.1 * away)
            measures |= {
                f"data_wait_{what}_s": value * math.exp(0.5 * away)
                for what, value in (("mean", row.wait_mean_s), ("sd", row.wait_sd_s))
            }
            settings = {**team, "message_wait": "data_wait"}
            label = f"draw {draw + 1}, {row.radius_m:g} m, and so on"
            records += [{"row": label, "settings": settings, "measures": measures}] * 3
    return Prediction(records)


def test_rows_that_are_predicted_rightly_are_explained_and_held():
    found = predicted(shift=0.0, spread=1.0)
    assert found.guess == pytest.approx(found.paper, abs=1e-9)
    # Student's t of 9 degrees of freedom, one more draw beside ten, and their standard deviation.
    assert found.reach[0, 0] == pytest.approx(2.262 * math.sqrt(11 / 10 * 10 / 9) * 10, rel=1e-3)
    rows = found.text().splitlines()
    assert rows[2].startswith("| goals % | 1.00 | ")
    assert rows[2].endswith("| 12 of 12 | 25 points | held by 10: yes; R² above 0.5: yes |")
    assert rows[4].startswith("| wait s | 1.00 | 0.61 | 0.75 | ")
    assert "R² above the formula's: yes" in rows[4]
    heads, *cells = found.cells()
    assert len(cells) == 48
    assert dict(zip(heads, cells[2], strict=True))["paper"] == "0.32"


def test_rows_that_are_predicted_wrongly_are_neither():
    found = predicted(shift=3.0, spread=1.0)
    goals = found.text().splitlines()[2]
    assert "| 0 of 12 | 25 points | held by 10: no; R² above 0.5: no |" in goals


def test_the_other_guesses_know_the_rows_that_were_fitted_to_only():
    found = predicted(shift=0.0, spread=1.0)
    seen = [row for row in PAPER_TABLE if row.radius_m in {5, 30}]
    goals = np.mean([row.goals_percent for row in seen])
    assert found.formula[:, 0] == pytest.approx([goals] * 12)
    one = math.exp(
        np.mean([math.log(r.wait_mean_s / (r.uavs + r.ugvs) ** 2 / r.radius_m) for r in seen])
    )
    assert math.exp(found.formula[0, 2]) == pytest.approx(one * 4**2 * 10)
    assert math.exp(found.regression[-1, 2]) > 3 * math.exp(found.regression[0, 2])


def test_what_predicts_is_what_was_fitted():
    experiment, _ = load_experiment("prediction")
    assert experiment.phase(experiment.first_seed) == "confirmation"
    with DRAWN.open(encoding="utf-8") as file:
        drawn = list(csv.DictReader(file))
    for row in experiment.rows:
        number = int(row.label.partition(",")[0].removeprefix("draw "))
        settings = flat(row.settings)
        assert {key: value_text(settings[key]) for key in drawn[0]} == drawn[number - 1]
    assert len(experiment.rows) == 12 * len(drawn) == 12 * DRAWS
