"""How predicted links of many runs become a table and curves."""

import pytest

from sitl.experiment.analysis.link_prediction import MODELS_SHOWN, calibration, links_text, of_links
from sitl.experiment.plan_file import load_experiment


@pytest.fixture(scope="module")
def links():
    return load_experiment("links")[0]


def record(row, number, brier):
    bins = [[100, 30.0, 40.0], [10, 9.0, 1.0], *[[0, 0.0, 0.0]] * 8]
    keys = [name.replace(" ", "_") for name in MODELS_SHOWN]
    measures = {f"{score}_{key}": brier for key in keys for score in ("brier", "log_loss")}
    curves = {"links": dict.fromkeys(MODELS_SHOWN, bins)}
    return {"row": row.label, "number": number, "measures": measures, "curves": curves}


def test_only_runs_of_the_first_row_count(links):
    first, second, *_ = links.rows
    runs = [record(first, 1, 0.1), record(first, 2, 0.3), record(second, 1, 0.9)]
    assert of_links(links, runs) == runs[:2]
    text = links_text(links, runs)
    assert "| with the map | 0.200 [" in text
    assert len(text.splitlines()) == 2 + len(MODELS_SHOWN)


def test_bins_of_all_runs_are_added_and_those_of_few_links_left_out(links):
    runs = [record(links.rows[0], number, 0.1) for number in range(1)]
    expected, seen = calibration(runs, "distance")
    assert (expected.tolist(), seen.tolist()) == ([0.3], [0.4])
    twice = [record(links.rows[0], number, 0.1) for number in range(2)]
    expected, seen = calibration(twice, "distance")
    assert (expected.tolist(), seen.tolist()) == ([0.3, 0.9], [0.4, 0.1])


def test_runs_without_predictions_give_no_table(links):
    plain = {"row": links.rows[0].label, "number": 1, "measures": {}, "curves": {}}
    assert not links_text(links, [plain])
