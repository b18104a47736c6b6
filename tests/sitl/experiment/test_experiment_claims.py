"""Effects are the textbook's, and verdicts follow from declared rules and the runs alone."""

import math

import numpy as np
import pytest

from air_router.errors import UsageError
from sitl.experiment.analysis import claims, statistics, tables
from sitl.experiment.analysis.statistics import Runs
from sitl.experiment.plan_file import load_experiment


@pytest.fixture(scope="module")
def stats():
    """Not imported by every worker that collects this."""
    return pytest.importorskip("scipy.stats", reason="SciPy is not installed (extra experiments)")


def test_effects_are_welchs_and_the_paired_t(stats):
    chance = np.random.default_rng(4)
    a, b = chance.normal(1.0, 1.0, 9), chance.normal(0.0, 3.0, 14)
    ours = statistics.contrast([a, -b])
    theirs = stats.ttest_ind(a, b, equal_var=False)
    assert ours.value / ours.error == pytest.approx(theirs.statistic)
    assert ours.interval()[1:] == pytest.approx(tuple(theirs.confidence_interval()))
    paired = statistics.contrast([a - b[:9]])
    theirs = stats.ttest_rel(a, b[:9])
    assert paired.interval()[1:] == pytest.approx(tuple(theirs.confidence_interval()))
    wider = tuple(theirs.confidence_interval(1 - 0.05 / 4))  # together with three others
    assert paired.interval(4)[1:] == pytest.approx(wider)
    assert math.isnan(statistics.contrast([a, b[:1]]).value)


def test_what_is_detectable_is_found_four_times_in_five(stats):
    effect = statistics.Effect(0.0, 1.5, 28.0)
    for tests in (1, 5):
        critical = stats.t.isf(0.025 / tests, 28.0)
        power = stats.nct.sf(critical, 28.0, effect.detectable(tests) / 1.5)
        assert power == pytest.approx(0.8, abs=0.01)


def test_cases_of_one_run_are_not_independent():
    """Where each run has one outcome k times, the design effect is k."""
    outcomes = np.array([1.0, 1.0, 1.0, 0.0] * 10)
    single, design = statistics.share_above(outcomes, 1 - outcomes, (50, 50))
    assert design == pytest.approx(40 / 39)
    fivefold, design = statistics.share_above(5 * outcomes, 5 * (1 - outcomes), (50, 50))
    assert design == pytest.approx(5 * 40 / 39)
    assert (single.value, fivefold.value, fivefold.freedom) == (25.0, 25.0, 39.0)
    own, theirs = 0.75 * 0.25 / 39, 0.25 / 100
    assert single.error == pytest.approx(100 * math.sqrt(own + 40 / 39 * theirs))
    assert fivefold.error == pytest.approx(100 * math.sqrt(own + 5 * 40 / 39 * theirs))
    every, design = statistics.share_above(outcomes + 1, 0 * outcomes, (50, 50))
    assert (every.value, design) == (50.0, 1.0)


def load(tmp_path, text):
    path = tmp_path / "experiment.yaml"
    path.write_text(text, encoding="utf-8")
    return load_experiment(str(path))[0]


def made(experiment, seeds, measures, phase="confirmation"):
    """Runs of an experiment; `measures` makes them of a row's settings and a seed number."""
    return [
        {
            "row": row.label,
            "number": number,
            "phase": phase,
            "rules": experiment.rules,
            "settings": row.settings,
            "measures": measures(row.settings, number),
        }
        for row in experiment.rows
        for number in range(seeds)
    ]


def table(goals, wait, seeds=8, area=lambda _: 40.0):
    """Runs of the paper's table, each number made from its row."""
    experiment, _ = load_experiment("table1")
    chance = np.random.default_rng(6)

    def measures(row, _):
        return {
            "goals_found_percent": goals(row) * (1 + 0.02 * chance.normal()),
            "goal_rate_area_percent": area(row) * (1 + 0.02 * chance.normal()),
            "wait_mean_s": wait(row) * (1 + 0.02 * chance.normal()),
        }

    return experiment, made(experiment, seeds, measures)


def as_claimed(row):
    uavs, ugvs, radius_m = row["uavs"], row["ugvs"], row["radius_m"]
    few = uavs == 2 and ugvs < 10 and radius_m < 30
    return 30 + 4 * ugvs + 0.6 * radius_m * (uavs == 1) + (20 if few else -4 * (uavs == 2))


@pytest.mark.parametrize("nothing", [{4: (0.0, 3.0)}, {4: (0.0, 0.0)}])
def test_a_ratio_leaves_out_runs_that_measured_nothing(tmp_path, nothing):
    text = "name: pair\ntitle: t\nquestion: q\nseeds: 5\ncross:\n  uavs: [1, 2]\npaired: [uavs]\n"
    experiment = load(tmp_path, text)

    def measures(row, number):
        one = 1.0 + number
        values = nothing.get(number, (one, 2.0 * one))
        return {"delivered_MB": values[row["uavs"] - 1]}

    one, two = experiment.rows
    runs = Runs(experiment, made(experiment, 5, measures))
    effect = runs.effect([(1.0, two), (-1.0, one)], "delivered_MB", ratio=True)
    assert math.exp(effect.value) == pytest.approx(2.0)
    assert effect.freedom == 3.0


def test_a_world_as_the_paper_claims_it_holds():
    found = claims.claims_of(
        *table(
            as_claimed,
            lambda row: row["radius_m"] * row["ugvs"] * 2 ** row["uavs"],
            area=lambda row: 30 + row["ugvs"] + 0.2 * row["radius_m"],
        )
    )
    assert {claim.number: claim.verdict for claim in found} == {
        1: "holds", 2: "holds", 3: "holds", 4: "holds", 5: "holds"
    }  # fmt: skip
    effects = {part.what: part.effect for claim in found for part in claim.parts}
    low, high = effects["longer with 2 UAVs than with 1"][1:]
    assert low < 2 < high < 2.2
    closest = next(part for part in found[0].parts if "best at 30 m" in part.what)
    assert closest.because.endswith("the least of 5")
    assert closest.effect.value == pytest.approx(20, abs=4)  # above 1 UAV with 5 UGVs


def test_a_world_that_is_the_same_for_all_denies_what_it_can():
    found = claims.claims_of(*table(lambda _: 80.0, lambda _: 1.0))
    verdicts = {part.what: part.verdict for claim in found for part in claim.parts}
    assert verdicts["10 UGVs find more goals than 3"] == "fails"
    assert found[0].brief == "not shown"
    assert verdicts["1 UAV and 10 UGVs are best at 5 m"] == "undecided"
    assert verdicts["it does not help at 30 m"] == "holds"
    assert found[2].verdict.startswith("in part. holds: it does not help 10 UGVs below 30 m; it")
    assert [claim.verdict for claim in found][3:] == ["fails", "fails"]


def test_a_row_is_held_against_its_oracle_run_by_run(tmp_path):
    cross = "cross: {policy: [round_robin, oracle], radius_m: [5, 30]}\n"
    experiment = load(tmp_path, f"name: yard\ntitle: x\n{cross}")

    def measures(row, number):
        oracle, near = row["policy"] == "oracle", row["radius_m"] == 5
        age_s = (30.0 + number) * (1 if oracle else 4 if near else 2)
        blank = dict.fromkeys(("wall_s", "speed_up", "goals_found", "waits", "wait_sd_s"), 1.0)
        blank |= dict.fromkeys(("data_waits", "header_waits"), 1.0)
        return {**blank, "service_age_mean_s": age_s, "goal_bound_gap_percent": None}

    found = tables.lines(experiment, made(experiment, 5, measures))
    shares = [line.values["of_oracle"] for line in found]
    assert [share.value for share in shares] == pytest.approx([25.0, 50.0, 100.0, 100.0])
    assert shares[0][1:] == pytest.approx((25.0, 25.0))  # as much in every pair of runs
    heads = tables.as_rows(experiment, found)[0]
    assert heads[-3:] == ["service age s", "% of the oracle's service", "x real time"]


def test_intervals_of_a_claims_parts_hold_together():
    experiment, records = table(lambda _: 80.0, lambda _: 1.0)
    (both,) = (claim for claim in experiment.claims if claim.number == 4)
    one = both.model_copy(update={"parts": both.parts[:1]})
    widths = []
    for claim in (both, one):
        (found,) = claims.claims_of(experiment.model_copy(update={"claims": (claim,)}), records)
        widths.append(found.parts[0].effect.high - found.parts[0].effect.value)
    assert 1.13 < widths[0] / widths[1] < 1.17  # of 97.5 % and of 95 %


def test_few_runs_decide_nothing():
    chance = np.random.default_rng(7)
    experiment, records = table(lambda _: 70 + 40 * chance.normal(), lambda _: 1.0, seeds=2)
    found = claims.claims_of(experiment, records)
    assert found[1].verdict == "undecided"
    part = found[1].parts[0]
    assert "detectable: " in part.because
    assert float(part.because.rpartition(" ")[2]) > 20
    alone = [record for record in records if record["number"] == 0]
    assert claims.claims_of(experiment, alone)[1].parts[0].because == "too few runs"


def test_spikes_and_complete_interactions_are_seen():
    experiment, _ = load_experiment("field")

    def verdicts(complete, broken, busiest, seeds=12):
        def measures(row, number):
            ours = row["protocol"] == "ours"  # the claim is about the paper's protocol
            return {
                "exchanges_complete": 500 if ours else complete,
                "exchanges_broken": 0 if ours else broken + (number % 2),
                "busiest_tenth_percent": 99.0 if ours else busiest + 0.1 * number,
            }

        (claim,) = claims.claims_of(experiment, made(experiment, seeds, measures))
        return [part.verdict for part in claim.parts], claim.parts[0].because

    verdict, because = verdicts(500, 1, 90)
    assert verdict == ["holds", "holds"]
    assert "; 6018 cases, design effect " in because
    assert verdicts(500, 40, 30)[0] == ["fails", "fails"]
    assert verdicts(500, 4, 49.5)[0] == ["undecided", "undecided"]


def test_returns_diminish_by_an_interaction_and_not_by_two_tests():
    experiment, _ = load_experiment("passive")
    chance = np.random.default_rng(9)
    luck = chance.normal(0, 30, 8)  # what both rows of a pair meet

    def verdicts(passive, seeking):
        def measures(row, number):
            goals = (passive if row["passive"] else seeking)(row["ugvs"])
            return {
                "goal_rate_area_percent": goals + luck[number] + 0.1 * chance.normal(),
                "map_age_mean_s": 200.0 + 10 * row["ugvs"] * row["passive"] + chance.normal(),
            }

        (claim,) = claims.claims_of(experiment, made(experiment, 8, measures))
        return {part.what.split(",")[0]: part.verdict for part in claim.parts}

    apart = verdicts(lambda n: 30 + 4 * min(n, 5), lambda n: 30.0 + 4 * n)
    assert apart["with seeking it loses less than without (interaction)"] == "holds"
    assert apart["from 2 to 10 UGVs"] == "holds"
    assert apart["seeking finds goals sooner with 10 UGVs"] == "holds"
    alike = verdicts(lambda n: 30 + 4 * min(n, 5), lambda n: 30.0 + 4 * min(n, 5))
    assert alike["with seeking it loses less than without (interaction)"] == "fails"
    assert alike["seeking finds goals sooner with 10 UGVs"] == "fails"


def test_runs_are_pairs_by_their_seed_and_not_by_their_place():
    experiment, _ = load_experiment("passive")

    def measures(row, number):
        value = 10.0 * number - 4 * row["passive"]
        return {"goal_rate_area_percent": value, "map_age_mean_s": None}

    records = made(experiment, 6, measures)
    lost = {"passive, 10 UGVs", "not passive, 2 UGVs"}
    kept = [each for each in records if not (each["row"] in lost and each["number"] == 2)]
    (claim,) = claims.claims_of(experiment, kept)
    maps, goals = claim.parts[-2:]
    assert (maps.verdict, maps.because) == ("undecided", "too few runs")
    assert goals.effect == pytest.approx((4.0, 4.0, 4.0))


def test_verdicts_state_from_which_runs_and_rules_they_come():
    experiment, records = table(lambda _: 80.0, lambda _: 1.0, seeds=2)
    assert claims.claims_of(experiment, records[2:]) == []  # a row has no runs
    explored = [{**record, "phase": "exploration"} for record in records]
    assert claims.claims_of(experiment, explored)[4].verdict == "fails, on exploration seeds"
    later = [*records[1:], {**records[0], "rules": "of before"}]
    assert claims.claims_of(experiment, later)[4].verdict == (
        "fails, by rules that changed after runs were made"
    )
    (other,) = (claim for claim in experiment.claims if claim.number == 5)
    part = other.parts[0].model_copy(update={"measure": "goals_lost"})
    wrong = experiment.model_copy(update={"claims": (other.model_copy(update={"parts": (part,)}),)})
    assert wrong.rules != experiment.rules
    with pytest.raises(UsageError, match="'goals_lost'; no run has this measure"):
        claims.claims_of(wrong, records)


def test_only_pairs_that_differ_alike_are_put_together(tmp_path):
    teams = ("5, policy: round_robin", "5, policy: rendezvous")
    teams += ("30, policy: freshest", "30, policy: rendezvous")
    text = "".join(f"  - {{radius_m: {team}}}\n" for team in teams)
    experiment = load(tmp_path, f"name: mixed\ntitle: x\nrows:\n{text}")
    records = made(experiment, 2, lambda *_: dict.fromkeys(claims.MEASURES, 1.0))
    assert [(one.row, one.base) for one in claims.compared(Runs(experiment, records))] == [
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
    experiment = load(tmp_path, PAIRED)
    chance = np.random.default_rng(8)
    luck = chance.normal(0, 30, 8)  # what both rows of a pair meet

    def measures(row, number):
        mean = 50 + luck[number] + 2 * (row["policy"] == "freshest")
        return {measure: mean + 0.5 * chance.normal() for measure in claims.MEASURES}

    runs = Runs(experiment, made(experiment, 8, measures))
    found = claims.compared(runs)
    assert [one[:3] for one in found] == [
        ("freshest, 5 m", "round robin, 5 m", 8),
        ("freshest, 30 m", "round robin, 30 m", 8),
        ("freshest, all", "round robin, all", 16),
    ]
    effects = [runs.effect(one.weights, "wait_mean_s") for one in found]
    assert all(effect.value == pytest.approx(2, abs=0.6) for effect in effects)
    assert effects[2].value == pytest.approx((effects[0].value + effects[1].value) / 2)
    assert effects[2].error < effects[0].error
    value, low, high = effects[0].interval(3)  # as many are compared
    text = f"{value:+.1f} [{low:+.1f}, {high:+.1f}]; detectable: {effects[0].detectable(3):.1f}"
    heads, first, *_ = claims.comparisons(runs)
    assert first[heads.index("wait, s")] == text


@pytest.mark.parametrize(
    ("syncs", "within"),
    [((100, 101, 99), "yes"), ((150, 151, 149), "no"), ((60, 100, 150), "open")],
)
def test_what_is_within_a_tenth_is_decided_by_the_interval_of_the_ratio(syncs, within):
    experiment, _ = load_experiment("fidelity")

    def flights(numbers):
        measures = dict.fromkeys(claims.FLIGHT_MEASURES, 1.0)
        return [
            {"row": row.label, "number": number, "measures": measures | {"syncs": each}}
            for row in experiment.rows
            for number, each in enumerate(numbers[row.settings["world"]])
        ]

    both = flights({"mission": syncs, "processes": (100, 100, 100)})

    def likeness_of(records):
        lines = claims.likeness(Runs(experiment, records)).splitlines()
        return {cells[1].strip(): cells[2:-1] for cells in (line.split("|") for line in lines)}

    here, there, ratio, verdict = map(str.strip, likeness_of(both)["syncs, both directions"])
    mean = math.prod(syncs) ** (1 / 3)
    assert (here, there, verdict) == (f"{mean:.1f}", "100.0", within)
    assert ratio.startswith(f"{mean / 100:.2f} (")
    assert likeness_of(both)["searches"][-1].strip() == "yes"
    # Fading that both sides meet alike is no doubt about their ratio.
    alike = likeness_of(flights({"mission": syncs, "processes": syncs}))
    assert alike["syncs, both directions"][2].strip() == "1.00 (1.00 to 1.00)"
    assert claims.likeness(Runs(experiment, both[:3])) == ""


def test_experiments_are_put_beside_a_real_px4():
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
    head, _, first, *_ = claims.likeness(Runs(experiment, records)).splitlines()
    assert "| experiments | real PX4 |" in head
    assert first == "| searches | 9.0 | 10.0 | 0.90 (0.90 to 0.90) | yes |"
    assert "| goals found |" in claims.likeness(Runs(experiment, records))
    for record in records:
        del record["measures"]["goals_found"]  # robots on patrol look for nothing
    assert "goals" not in claims.likeness(Runs(experiment, records))
