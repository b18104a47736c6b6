"""Experiment files, their rows, and seeds that are the same everywhere."""

import dataclasses
import re

import pytest

from air_router.errors import AirRouterError, ExitCode
from mocha_link.team.document import DocumentError
from sitl.experiment.analysis.tables import PAPER_TABLE
from sitl.experiment.campaign.running import OtherFilesError, put_together, settings_of
from sitl.experiment.plan import NoSuchRowError, Task
from sitl.experiment.plan_file import UnknownPlaceError, experiment_names, load_experiment
from sitl.experiment.settings import MissionTimers, PaperModel, RunSettings

PAIRED = """
name: pair
title: Two policies
seeds: 4
settings: {ugvs: 3, paper: {cut: drop}}
cross:
  policy: [round_robin, freshest]
  radius_m: [5, 30]
"""


def load(tmp_path, text):
    path = tmp_path / "experiment.yaml"
    path.write_text(text, encoding="utf-8")
    return load_experiment(str(path))[0]


def test_the_papers_table_has_its_24_rows():
    experiment, _ = load_experiment("table1")
    rows = [
        (row.settings["radius_m"], row.settings["uavs"], row.settings["ugvs"])
        for row in experiment.rows
    ]
    assert rows == [row[:3] for row in PAPER_TABLE]
    assert experiment.rows[-1].label == "30 m, 2 UAVs, 10 UGVs"
    assert experiment.seeds == 30
    assert len(list(experiment.tasks(range(30)))) == 720


@pytest.mark.parametrize("name", experiment_names())
def test_every_shipped_experiment_can_be_run(name):
    experiment, _ = load_experiment(name)
    assert experiment.name == name
    assert experiment.question
    seeds = {task.seed for task in experiment.tasks(range(2))}
    assert len(seeds) >= 2
    for row in experiment.rows:
        assert isinstance(settings_of(experiment.task(row, 0)), RunSettings)


def test_seeds_follow_from_names_alone():
    experiment, _ = load_experiment("table1")
    assert experiment.seed(experiment.rows[0], 0) == 8601995132206558445
    assert len({task.seed for task in experiment.tasks(range(30))}) == 720


def test_seeds_from_a_number_on_are_for_confirmation(tmp_path):
    text = PAIRED + "first_seed: 7\nconfirmation_seed: 9\n"
    experiment = load(tmp_path, text)
    assert experiment.first_seed == 7
    tasks = experiment.tasks(range(7, 11))
    assert [task.phase for task in tasks][::4] == ["exploration"] * 2 + ["confirmation"] * 2
    shipped, _ = load_experiment("table1")
    assert (shipped.first_seed, shipped.phase(10_000)) == (0, "exploration")
    assert shipped.phase(10_001) == "confirmation"


def test_rows_that_differ_in_paired_settings_only_share_their_seeds(tmp_path):
    experiment = load(tmp_path, PAIRED)
    assert [row.label for row in experiment.rows] == [
        "round robin, 5 m",
        "round robin, 30 m",
        "freshest, 5 m",
        "freshest, 30 m",
    ]
    a, b, c, d = ([experiment.seed(row, n) for n in range(4)] for row in experiment.rows)
    assert a == c
    assert b == d
    assert not set(a) & set(b)
    assert len({row.fingerprint for row in experiment.rows}) == 4


def test_rows_are_called_after_what_they_differ_in(tmp_path):
    text = "name: a\ntitle: b\ncross:\n  passive: [true, false]\n  uavs: [1, 2]\n"
    text += (
        "  timers: [{init_s: 30, search_s: 2.5}]\n  explorer: [{progress: 0.2}, {idle: explore}]\n"
    )
    assert [row.label for row in load(tmp_path, text).rows][::3] == [
        "passive, 1 UAV, 0.2",
        "passive, 2 UAVs, explore",
        "not passive, 2 UAVs, 0.2",
    ]


def test_every_row_is_crossed(tmp_path):
    text = PAIRED.replace("ugvs: 3", "ugvs: 3, timers: {init_s: 99}")
    text += "rows:\n  - {label: near, ugvs: 2}\n  - {values: [2, 1]}\n"
    experiment = load(tmp_path, text)
    rows = experiment.rows
    assert [row.label for row in rows][::3][:2] == [
        "near, round robin, 5 m",
        "near, freshest, 30 m",
    ]
    assert [row.settings["ugvs"] for row in rows] == [2] * 4 + [3] * 4
    settings = settings_of(experiment.task(rows[4], 0))
    assert (settings.values, settings.policy) == ((2.0, 1.0), "round_robin")
    assert settings.paper == PaperModel(cut="drop")
    assert settings.timers == MissionTimers(init_s=99)


def test_a_file_that_changed_under_way_is_not_mixed_in(tmp_path):
    experiment = load(tmp_path, PAIRED)
    row = experiment.rows[0]
    settings = {**row.settings, "sources": {**row.settings["sources"], "town": "0" * 16}}
    with pytest.raises(OtherFilesError, match=r"town\.yaml is not the file any more"):
        settings_of(Task("pair", dataclasses.replace(row, settings=settings), 0, 1))


WRONG = """
name: Bad One
title: x
seeds: 0
settings: {radus_m: 3, uavs: "1", paper: {cut: dop}, ugvs: null}
cross: {radius_m: [5, -1], uavs: 3}
rows: []
"""
SENSELESS = """
name: two
title: x
settings: {town: nowhere}
rows: [{ugvs: 3}, {ugvs: 3}, {mission: none.yaml, label: third}]
paired: [polcy]
"""


def problems_in(error):
    return re.findall(r"yaml:(\d+):(\d+): .*\[(.+)\]", str(error.value))


def test_all_problems_of_a_file_are_reported_with_their_places(tmp_path):
    with pytest.raises(DocumentError) as error:
        load(tmp_path, WRONG)
    assert problems_in(error) == [
        ("2", "7", "wrong-form"),
        ("4", "8", "out-of-range"),
        ("5", "12", "unknown-key"),
        ("5", "30", "wrong-type"),
        ("5", "48", "unknown-word"),
        ("5", "60", "wrong-type"),
        ("6", "23", "out-of-range"),
        ("6", "34", "wrong-type"),
        ("7", "7", "wrong-length"),
    ]
    assert "did you mean 'radius_m'?" in str(error.value)


def test_what_only_shows_between_values_is_reported_too(tmp_path):
    with pytest.raises(DocumentError, match="'polcy' is no setting"):
        load(tmp_path, SENSELESS)
    with pytest.raises(DocumentError) as error:
        load(tmp_path, SENSELESS.replace("polcy", "policy"))
    assert sorted(code for _, _, code in problems_in(error)) == ["no-such-file", "same-name"]
    with pytest.raises(DocumentError, match="one-rows-key"):
        load(tmp_path, "name: a\ntitle: b\n")
    with pytest.raises(UnknownPlaceError, match=r"one of .*table1"):
        load_experiment("table9")


CLAIM = """
claims:
  - number: 1
    text: Freshest is better.
    parts:
      - what: it finds more
        measure: goals_found_percent
        contrast: [{rows: {policy: freshest}}, {weight: -1, rows: {policy: round_robin}}]
        more_than: 5
"""


def test_claims_are_declared_with_what_decides_them(tmp_path):
    experiment = load(tmp_path, PAIRED + CLAIM)
    assert experiment.task(experiment.rows[0], 0).rules == experiment.rules
    other = load(tmp_path, PAIRED + CLAIM.replace("more_than: 5", "more_than: 4"))
    assert len({experiment.rules, other.rules, load(tmp_path, PAIRED).rules}) == 3
    for wrong, message in (
        (CLAIM.replace("round_robin", "rendezvous"), r":16:\d+: no row has all of this"),
        (CLAIM.replace("more_than: 5", "each: true"), "set either more_than or less_than"),
        (
            CLAIM.replace("measure: goals_found_percent", "ratio: true"),
            "either a measure or a share",
        ),
    ):
        with pytest.raises(DocumentError, match=message):
            load(tmp_path, PAIRED + wrong)


def test_rows_are_chosen_by_settings_and_by_names():
    experiment, _ = load_experiment("table1")

    def chosen(*choices):
        return [row.label for row in experiment.chosen(choices)]

    assert len(chosen()) == 24
    assert chosen("radius_m=5", "ugvs=3,5", "uavs=1") == [
        "5 m, 1 UAV, 3 UGVs",
        "5 m, 1 UAV, 5 UGVs",
    ]
    assert len(chosen("30 m*")) == 6
    with pytest.raises(NoSuchRowError, match="'radius_m' is one of 5, 10, 20, 30"):
        chosen("radius_m=7")
    with pytest.raises(NoSuchRowError, match="no row fits 40"):
        chosen("40 m*")
    assert len(chosen("passive=false", "timers.init_s=150")) == 24  # the first is not written
    with pytest.raises(NoSuchRowError, match="'ugvz' is no setting of these rows"):
        chosen("ugvz=3")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("telemetry_s: 3", "row 'all': telemetry_s of 3"),
        ("uavs: 0, base_station: false", "no robot takes part"),
        ("world: processes, policy: oracle", "a policy that flies"),
    ],
)
def test_what_no_run_can_be_made_of_is_reported_before_any_begins(tmp_path, wrong, message):
    text = f"name: a\ntitle: b\nsettings: {{{wrong}}}\nrows: [{{ugvs: 0}}]\n"
    experiment = load(tmp_path, text)
    with pytest.raises(AirRouterError, match=message) as error:
        put_together(next(experiment.tasks(range(1))))
    assert error.value.exit_code is ExitCode.INVALID_FILE
