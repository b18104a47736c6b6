"""The paper's teams in several readings, and figures of claims: what they put beside each other."""

import made_up
import numpy as np
import pytest

from mocha_link.errors import MissingExtraError
from sitl.experiment.analysis import claims, statistics, tables
from sitl.experiment.plan_file import load_experiment


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch):
    monkeypatch.setattr(statistics, "_RESAMPLES", 100)  # intervals need not be exact here


@pytest.fixture
def figures():
    return pytest.importorskip("sitl.experiment.analysis.figures", exc_type=MissingExtraError)


def found_percent(row):
    """All of the team's goals, so many points fewer where it starts together."""
    return 60.0 + row.settings["ugvs"] - 20.0 * (row.settings["starts"] == "town")


@pytest.fixture
def together():
    """Made-up runs of `together`."""
    experiment, _ = load_experiment("together")
    records = [made_up.work(task) for task in experiment.tasks(range(2))]
    goals = {row.label: found_percent(row) for row in experiment.rows}
    for record in records:
        record["measures"]["goals_found_percent"] = goals[record["row"]]
    return experiment, records


def test_every_reading_is_put_beside_the_same_teams_of_the_paper(together):
    lines = tables.readings_text(*together).splitlines()
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines[2:]]
    means = {name: mean.partition(" ")[0] for name, mean, *_ in cells}
    assert means == {
        "starts: town, goals: town": "46.0",
        "starts: town, goals: seed": "46.0",
        "starts: seed, goals: town": "66.0",
        "starts: seed, goals: seed": "66.0",
    }
    one_uav = [row.goals_percent for row in tables.PAPER_TABLE if row.uavs == 1]
    assert {each[2] for each in cells} == {f"{np.mean(one_uav):.1f}"}
    heads, first, *_ = tables.as_rows(together[0], tables.lines(*together))
    assert first[heads.index("paper: goals %")] == "36.7"  # 5 m, 1 UAV, 3 UGVs


def test_one_reading_alone_or_teams_that_miss_runs_are_not_compared(together):
    experiment, records = together
    assert tables.readings_text(experiment, records[1:2]) == ""
    alone, _ = load_experiment("table1")
    assert tables.readings(alone) == {}
    other, _ = load_experiment("readings")  # varies more than places
    assert tables.readings(other) == {}


def test_readings_are_drawn_beside_the_paper_for_every_team_size(together, figures):
    panels = figures.draw_readings(*together).axes
    assert [one.get_title(loc="left") for one in panels] == [
        f"1 UAV, {ugvs} UGVs" for ugvs in (3, 5, 10)
    ]
    _, labels = panels[0].get_legend_handles_labels()
    assert set(labels) == {*tables.readings(together[0]), "the paper"}
    assert figures.draw_readings(together[0], together[1][:1]) is None


def test_ages_are_drawn_by_scenario_and_policy(figures):
    experiment, _ = load_experiment("patrols")
    ages = {"round_robin": 90.0, "rendezvous": 70.0, "tour": 60.0}
    records = [
        {
            "row": row.label,
            "number": number,
            "measures": {"exchange_age_mean_s": ages[row.settings["policy"]] + number},
        }
        for row in experiment.rows
        for number in range(3)
    ]
    (one,) = figures.draw_policies(experiment, records).axes
    _, labels = one.get_legend_handles_labels()
    assert labels == ["round robin", "tour", "rendezvous"]  # the same colours in every figure
    drawn = {dots.get_label(): dots.get_offsets()[:, 0].tolist() for dots in one.collections[1::2]}
    assert drawn["tour"] == [61.0] * 3
    assert figures.draw_policies(load_experiment("table1")[0], records) is None


def test_flights_are_drawn_as_factors_with_the_tenth_that_is_allowed(figures):
    experiment, _ = load_experiment("autopilot")
    searches = {"mission": 9.0, "px4": 10.0}
    records = [
        {
            "row": row.label,
            "number": number,
            "measures": dict.fromkeys(claims.FLIGHT_MEASURES, searches[row.settings["world"]]),
        }
        for row in experiment.rows
        for number in range(3)
    ]
    (one,) = figures.draw_fidelity(experiment, records).axes
    assert one.get_xlabel() == "experiments / real PX4"
    assert [text.get_text() for text in one.get_yticklabels()] == [*claims.FLIGHT_MEASURES.values()]
    dots = one.collections[-1].get_offsets()[:, 0].tolist()
    assert dots == pytest.approx([0.9] * len(claims.FLIGHT_MEASURES))
    assert figures.draw_fidelity(experiment, records[:3]) is None
