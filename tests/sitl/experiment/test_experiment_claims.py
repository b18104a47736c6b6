"""Tests of claims are the textbook's, and answers follow from the runs and nothing else."""

import numpy as np
import pytest

from sitl.experiment.analysis import claims, statistics, tables
from sitl.experiment.analysis.document_part import NoMarksError, fill
from sitl.experiment.analysis.paper import TABLE
from sitl.experiment.campaign.links import BUILDINGS_M, DISTANCES_M, judged, seen_links
from sitl.experiment.campaign.plan_file import load_experiment
from sitl.experiment.engine.result import CONTACT
from sitl.world.terrain import Raster

stats = pytest.importorskip("scipy.stats", reason="SciPy is not installed (extra experiments)")


def test_trends_are_kendalls():
    chance = np.random.default_rng(3)
    levels = np.repeat([3.0, 5.0, 10.0], 8)
    values = np.round(chance.normal(size=24) + 0.1 * levels, 1)  # with ties
    ours = statistics.growing([[(level, values[levels == level]) for level in (3.0, 5.0, 10.0)]])
    theirs = stats.kendalltau(levels, values, method="asymptotic", alternative="greater")
    assert ours.tau == pytest.approx(theirs.statistic)
    assert ours.p == pytest.approx(theirs.pvalue)
    flat = statistics.growing([[(3.0, np.ones(4)), (5.0, np.ones(4))]])
    assert np.isnan(flat.p)


def test_differences_are_welchs_and_the_paired_t():
    chance = np.random.default_rng(4)
    a, b = chance.normal(1.0, 1.0, 9), chance.normal(0.0, 3.0, 14)
    ours = statistics.above(a, b)
    theirs = stats.ttest_ind(a, b, equal_var=False, alternative="greater")
    assert ours.p_greater == pytest.approx(theirs.pvalue)
    interval = stats.ttest_ind(a, b, equal_var=False).confidence_interval()
    assert (ours.low, ours.high) == pytest.approx(tuple(interval))
    paired = statistics.paired_above(a, b[:9])
    assert paired.p_less == pytest.approx(stats.ttest_rel(a, b[:9], alternative="less").pvalue)
    same = statistics.paired_above(a, a)
    assert (same.value, same.p_greater) == (0.0, 0.5)


def test_holm_corrects_for_the_number_of_tests():
    assert statistics.holm([0.01, 0.04, 0.03, float("nan")])[:3] == pytest.approx(
        [0.03, 0.06, 0.06]
    )
    low, high = statistics.share_interval(1713, 1720)
    assert low < 1713 / 1720 < high


def runs(goals, wait, seeds=6, time=lambda _: 15.0):
    """Records of the paper's table; each number made from its row."""
    experiment, _ = load_experiment("table1")
    chance = np.random.default_rng(6)
    records = []
    for row, ours in zip(TABLE, experiment.rows, strict=True):
        for number in range(seeds):
            spread = 1 + 0.02 * chance.normal()
            measures = {
                "goals_found_percent": goals(row) * spread,
                "time_to_goal_mean_min": time(row) * spread,
                "wait_mean_s": wait(row) * spread,
                "waits": 1000,
            }
            records.append(
                {
                    "row": ours.label,
                    "number": number,
                    "phase": "confirmation",
                    "settings": {"radius_m": row.radius_m, "uavs": row.uavs, "ugvs": row.ugvs},
                    "measures": measures,
                }
            )
    return records


def test_a_world_as_the_paper_claims_it_confirms_all():
    found = claims.table_claims(
        runs(
            goals=lambda row: (
                30
                + 4 * row.ugvs
                + 0.3 * row.radius_m * (row.uavs == 1)
                + (6 if row.uavs == 2 and row.ugvs < 10 and row.radius_m < 30 else 0)
                - (9 if row.uavs == 2 and (row.ugvs == 10 or row.radius_m == 30) else 0)
            ),
            wait=lambda row: row.wait_mean_s + 0.01 * row.radius_m * row.ugvs * row.uavs,
            time=lambda row: 25 - row.ugvs - 0.1 * row.radius_m,
        )
    )
    assert [claim.number for claim in found] == [1, 2, 3, 4, 5]
    answers = {claim.number: claim.answer for claim in found}
    assert answers[1] == answers[4] == answers[5] == answers[2] == "confirmed", answers
    assert all(part.because for claim in found for part in claim.parts)


def test_a_world_that_is_the_same_for_all_confirms_nothing_but_no_help():
    found = claims.table_claims(runs(goals=lambda _: 80.0, wait=lambda _: 1.0))
    answers = [claim.answer for claim in found]
    assert [answers[0], answers[1], answers[3], answers[4]] == ["not confirmed"] * 4
    assert answers[2].startswith("depends: holds for it does not help 10 UGVs")


def test_waits_are_compared_with_the_papers_row_by_row():
    ratios = claims.near_paper(runs(lambda _: 80.0, lambda row: 1.5 * row.wait_mean_s))
    assert claims.within_factor(ratios) == 24
    ratios = claims.near_paper(
        runs(lambda _: 80.0, lambda row: (3 if row.uavs == 2 else 1) * row.wait_mean_s)
    )
    assert claims.within_factor(ratios) == 12


def test_spikes_and_complete_interactions_are_seen():
    def record(bins, broken, protocol="original"):
        measures = {"exchanges_complete": 1713, "exchanges_broken": broken}
        settings = {"protocol": protocol}
        return {"settings": settings, "measures": measures, "curves": {"bin_bytes": bins}}

    spiky = claims.field_claim([record([9000] + [10] * 19, 7)])
    assert spiky.answer == "confirmed"
    steady = claims.field_claim([record([100] * 20, 300)])
    assert steady.answer == "not confirmed"
    # The claim is about the paper's protocol: what ours completes makes up for nothing.
    both = claims.field_claim([record([100] * 20, 40), *[record([9000, 0], 0, "ours")] * 9])
    assert both.answer == "not confirmed"
    assert both.parts[0].because.endswith("with our protocol 100.00 % of 15417")


def test_claims_are_for_the_rows_that_they_are_about(tmp_path):
    experiment, _ = load_experiment("table1")
    records = runs(lambda _: 80.0, lambda _: 1.0, seeds=2)
    found = claims.claims_of(experiment, records)
    assert [claim.number for claim in found] == [1, 2, 3, 4, 5]
    assert all(claim.verdict == claim.answer for claim in found)
    explored = [{**record, "phase": "exploration"} for record in records]
    told = [claim.verdict for claim in claims.claims_of(experiment, explored)]
    assert all(verdict.endswith(", on exploration seeds") for verdict in told)
    assert claims.claims_of(experiment, records[2:]) == []  # a row has no runs
    path = tmp_path / "mine.yaml"
    path.write_text("name: table1\ntitle: My own\nrows: [{ugvs: 3}]\n", encoding="utf-8")
    mine, _ = load_experiment(str(path))
    assert claims.claims_of(mine, [{**records[0], "row": "all"}]) == []


def test_diminishing_returns_are_seen():
    def records(passive, goals):
        return [
            {
                "row": f"{passive} {ugvs}",
                "number": number,
                "settings": {"passive": passive, "ugvs": ugvs},
                "measures": {
                    "goals_found": goals(ugvs) + 0.1 * (number % 3),
                    "goals_found_percent": 5.0 * goals(ugvs) + 0.3 * (number % 3),
                    "map_age_mean_s": 200.0 + 10 * ugvs * passive + number,
                },
            }
            for ugvs in (2, 5, 10)
            for number in range(6)
        ]

    claim = claims.passive_claim(
        records(True, lambda n: 3 + min(n, 5)) + records(False, lambda n: 3.0 + n)
    )
    assert claim.answer == "confirmed"


def test_runs_are_pairs_by_their_seed_and_not_by_their_place():
    records = [
        {
            "number": number,
            "settings": {"passive": passive, "ugvs": ugvs},
            "measures": {
                "goals_found": 9,
                "goals_found_percent": 10.0 * number - 4 * passive,
                "map_age_mean_s": None,
            },
        }
        for passive in (False, True)
        for ugvs in (2, 5, 10)
        for number in range(6)
        if (passive, number) != (True, 2)  # one that was given up
    ]
    *_, older, no_older, more = claims.passive_claim(records).parts
    assert more.holds
    assert more.because.endswith("10 UGVs: +4.0 points [+4.0, +4.0]")
    # Nothing is known of maps: neither that they are older, nor that they are not.
    assert (older.holds, no_older.holds) == (False, False)


def test_only_pairs_that_differ_alike_are_put_together(tmp_path):
    path = tmp_path / "mixed.yaml"
    teams = ("5, policy: round_robin", "5, policy: rendezvous")
    teams += ("30, policy: freshest", "30, policy: rendezvous")
    text = "".join(f"  - {{radius_m: {team}}}\n" for team in teams)
    path.write_text(f"name: mixed\ntitle: x\nrows:\n{text}", encoding="utf-8")
    experiment, _ = load_experiment(str(path))
    measures = dict.fromkeys(tables.MEASURES, 1.0)
    records = [
        {"row": row.label, "number": number, "measures": measures}
        for row in experiment.rows
        for number in range(2)
    ]
    assert [(one.row, one.base) for one in tables.compared(experiment, records)] == [
        ("5 m, rendezvous", "5 m, round robin"),
        ("30 m, rendezvous", "30 m, freshest"),
    ]


PAIRED = """
name: pair
title: Two policies
seeds: 8
cross: {policy: [round_robin, freshest], radius_m: [5, 30]}
"""


def test_rows_with_the_same_seeds_are_compared_run_by_run(tmp_path):
    path = tmp_path / "pair.yaml"
    path.write_text(PAIRED, encoding="utf-8")
    experiment, _ = load_experiment(str(path))
    chance = np.random.default_rng(8)
    luck = chance.normal(0, 30, 8)  # what both rows of a pair meet
    records = [
        {
            "row": row.label,
            "number": number,
            "measures": {
                measure: 50
                + luck[number]
                + 2 * (row.settings["policy"] == "freshest")
                + 0.5 * chance.normal()
                for measure in tables.MEASURES
            },
        }
        for row in experiment.rows
        for number in range(8)
    ]
    found = tables.compared(experiment, records)
    assert [(one.row, one.base, one.runs) for one in found] == [
        ("freshest, 5 m", "round robin, 5 m", 8),
        ("freshest, 30 m", "round robin, 30 m", 8),
        ("freshest, all", "round robin, all", 16),
    ]
    assert all(one.p["pose_age_mean_s"] < 0.01 for one in found)
    assert found[0].differences["wait_mean_s"].value == pytest.approx(2, abs=0.6)
    assert "**+" in tables.pairs_as_markdown(found)


def test_a_document_is_filled_between_its_marks(tmp_path):
    document = tmp_path / "page.md"
    document.write_text(
        "# Title\n<!-- begin a table -->\nold\n<!-- end -->\nkept\n"
        "![picture](images/experiments/a-goals.png)\n",
        encoding="utf-8",
    )
    for name in ("goals", "waits"):
        (tmp_path / f"{name}.png").write_bytes(name.encode())
    figures = [tmp_path / "goals.png", tmp_path / "waits.png"]
    (tmp_path / "evidence").mkdir()
    kept = tmp_path / "evidence" / "a-table.csv"
    kept.touch()
    rows = {"table": [["runs"], ["1, 2"]], "claims": [["claim"], ["1"]]}
    for content in ("new \\1", "newer"):
        fill(document, "a", {"table": content, "claims": "none"}, figures, rows)
    # nothing is known now: what is there stays
    fill(document, "a", {"table": ""}, [], {"table": [["runs"]]})
    assert document.read_text(encoding="utf-8").startswith(
        "# Title\n<!-- begin a table -->\nnewer\n<!-- end -->\nkept\n"
    )
    assert [p.name for p in (tmp_path / "images" / "experiments").iterdir()] == ["a-goals.png"]
    assert kept.read_text() == 'runs\n"1, 2"\n'
    assert [p.name for p in kept.parent.iterdir()] == [kept.name]
    with pytest.raises(NoMarksError, match="no place for 'b'"):
        fill(document, "b", {"table": "x"}, figures, {})


class Seen:
    """Two robots, a wall between them in the second half of the run."""

    kinds = ("ugv", "ugv", "uav")
    sample_times_s = np.arange(4.0)
    positions_m = np.array(
        [[[0, 0], [20, 0], [5, 5]]] * 2 + [[[0, 30], [20, 30], [5, 5]]] * 2, dtype=np.float32
    )
    contacts = np.array([(0.0, 2.0, 1, 0), (0.0, 4.0, 0, 2)], dtype=CONTACT)


def test_cases_of_links_are_counted_with_what_stands_between():
    cells = np.ones((100, 80), dtype=np.uint8)
    cells[60:, 36:50] = 3  # a building of 7 m, north of 20 m
    counts = np.array(seen_links(Seen(), Raster(-10.0, -10.0, 0.5, cells)))
    assert counts.sum(axis=(0, 1)).tolist() == [4, 2]
    distance = np.searchsorted(DISTANCES_M, 20.0, side="right") - 1
    wall = np.searchsorted(BUILDINGS_M, 7.0, side="right") - 1
    assert counts[distance, 0].tolist() == [2, 2]
    assert counts[distance, wall].tolist() == [2, 0]


def test_the_map_helps_where_walls_matter():
    shape = (len(DISTANCES_M) - 1, len(BUILDINGS_M) - 1, 2)
    counts = np.zeros(shape)
    counts[..., 0] = 100
    far = np.arange(shape[0])[:, None] + 3 * np.arange(shape[1])[None, :]
    counts[..., 1] = 100 / (1 + np.exp((far - 12) / 2))
    without, with_map = (judged(counts, counts, buildings=flag) for flag in (False, True))
    assert with_map.brier < without.brier
    assert with_map.area > without.area
