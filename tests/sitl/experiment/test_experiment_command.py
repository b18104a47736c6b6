"""`sitl experiment`: runs are kept, resumed and never mixed; tables, files and figures of them."""

import csv
import hashlib
import json
import math
import re
import sys
from pathlib import Path

import made_up
import numpy as np
import pytest

from air_router.errors import UsageError
from mocha_link.errors import MissingExtraError
from sitl.cli import experiment_command as command
from sitl.cli.cli import main
from sitl.experiment.analysis import statistics, tables
from sitl.experiment.analysis.report import NoMarksError
from sitl.experiment.analysis.statistics import interval, ratio, spread
from sitl.experiment.campaign.campaign import MixedRunsError, RunOutcome
from sitl.experiment.campaign.provenance import program
from sitl.experiment.campaign.running import UnfitSettingsError
from sitl.experiment.campaign.runs import (
    InUseError,
    RunLogError,
    read_archive,
    run_log,
    write_archive,
)
from sitl.experiment.plan_file import load_experiment
from sitl.experiment.settings import RunSettings
from tests.command_lines import options_for
from tests.full_disk import files_of_at_most

ROOT = Path(__file__).parents[3]
SMALL = """
name: small
title: A small experiment
seeds: 3
settings: {duration_s: 600, timers: {init_s: 99}}
cross: {radius_m: [5, 30], ugvs: [3, 5]}
"""


class Here:
    """A process pool in this process; it can be interrupted after some runs."""

    def __init__(self, most=math.inf):
        self.most = most
        self.made = []

    def run(self, work, tasks, _workers, may_begin=lambda _task: True):
        for task in filter(may_begin, tasks):
            if len(self.made) == self.most:
                raise KeyboardInterrupt
            self.made.append((task.row.label, task.number))
            try:
                yield RunOutcome(task, work(task))
            except ZeroDivisionError as error:
                yield RunOutcome(task, None, str(error))


@pytest.fixture
def sitl(tmp_path, monkeypatch):
    """Runs the command on the small experiment; returns its exit code and its pool."""
    path = tmp_path / "small.yaml"
    path.write_text(SMALL, encoding="utf-8")
    monkeypatch.setattr(statistics, "_RESAMPLES", 100)  # intervals need not be exact here

    def call(  # noqa: PLR0913 - what tests vary
        *options,
        experiment=path,
        out=True,
        pool=None,
        work=made_up.work,
        figures=False,
        try_out=None,
    ):
        fixed = [str(experiment), *(["--out", str(tmp_path / "out")] if out else [])]
        figured = [] if figures else ["--no-figures"]
        arguments = options_for(command.run, *fixed, *figured, *options)
        pool = pool or Here()
        monkeypatch.setattr(command, "make_runs", pool.run)
        return command.run_with(arguments, work, try_out), pool

    call.path = path
    return call


def runs_in(folder):
    with run_log(folder) as log:
        return log.records


def rows_of(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_stopped_experiment_leaves_the_document_as_it_is(sitl, tmp_path):
    page, archive = tmp_path / "page.md", tmp_path / "small-runs.jsonl.xz"
    page.write_text("<!-- begin small facts -->\nearlier\n<!-- end -->\n", encoding="utf-8")
    text = page.read_text(encoding="utf-8")
    options = ("--docs", str(page), "--archive", str(archive))
    assert sitl(*options, pool=Here(most=5))[0] == 130
    assert page.read_text(encoding="utf-8") == text
    assert sitl(*options)[0] == 0
    assert "12 runs" in page.read_text(encoding="utf-8")


def test_a_stopped_experiment_goes_on_where_it_was(sitl, tmp_path, capsys):
    archive = tmp_path / "small-runs.jsonl.xz"
    code, pool = sitl("--archive", str(archive), pool=Here(most=5))
    assert code == 130
    assert not archive.exists()  # of a part of the runs
    assert "stopped; 5 of 12 runs are kept" in capsys.readouterr().err
    with (tmp_path / "out" / "runs.jsonl").open("a") as file:
        file.write('{"row": "5 m, 3 UG')  # the power went while this line was written
    code, again = sitl()
    assert code == 0
    assert len(again.made) == 7
    assert not set(pool.made) & set(again.made)
    out = capsys.readouterr()
    assert "5 of 12 runs are there" in out.err
    assert "A small experiment" in out.out
    assert max(map(len, out.out.splitlines())) <= 160
    for head in ("goals over time %", "data wait s", "complete exchanges", "map peak s"):
        assert head in out.out
    code, third = sitl()
    assert (code, third.made) == (0, [])
    _, more = sitl("--seeds", "4", "--rows", "radius_m=5")
    assert sorted(more.made) == [("5 m, 3 UGVs", 3), ("5 m, 5 UGVs", 3)]
    _, fresh = sitl("--fresh")
    assert len(fresh.made) == 12


def test_runs_of_other_settings_are_not_mixed_in(sitl, tmp_path):
    sitl()
    sitl.path.write_text(SMALL.replace("99", "98"), encoding="utf-8")
    with pytest.raises(MixedRunsError, match="with other settings"):
        sitl()
    # Rows are as they were, but seeds follow from what they differ in besides what is paired.
    sitl.path.write_text(SMALL + "paired: [radius_m]\n", encoding="utf-8")
    with pytest.raises(MixedRunsError, match="or seeds"):
        sitl()
    with (tmp_path / "out" / "runs.jsonl").open("a") as file:
        file.write('{"no": "run"}\n')
    with pytest.raises(RunLogError, match=r"runs\.jsonl:13: not a run"):
        sitl()
    other = tmp_path / "other"
    with run_log(other), pytest.raises(InUseError, match="in use by another"), run_log(other):
        pass


def test_each_phase_has_a_folder_of_its_own(sitl, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sitl.path.write_text(SMALL + "first_seed: 8\nconfirmation_seed: 11\n", encoding="utf-8")
    numbers = []
    for first in ([], ["--first-seed", "11"]):
        _, pool = sitl("--rows", "5 m, 3 UGVs", *first, out=False)
        numbers.append([number for _, number in pool.made])
    assert numbers == [[8, 9, 10], [11, 12, 13]]
    folders = sorted(path.name for path in (tmp_path / "experiments").iterdir())
    assert folders == ["small", "small-confirmation"]


def test_exploration_and_confirmation_are_never_mixed(sitl, tmp_path, capsys):
    sitl.path.write_text(SMALL + "confirmation_seed: 2\n", encoding="utf-8")
    with pytest.raises(MixedRunsError, match="seeds 0 to 2 are of both phases"):
        sitl()
    sitl("--seeds", "2", "--json")
    summary = json.loads(capsys.readouterr().out)
    assert (summary["phase"], summary["seeds"]) == ("exploration", [0, 1])
    with pytest.raises(MixedRunsError, match="out holds exploration runs, and confirmation runs"):
        sitl("--seeds", "2", "--first-seed", "2")
    after = str(tmp_path / "after")
    _, pool = sitl("--seeds", "2", "--first-seed", "2", "--out", after)
    assert {number for _, number in pool.made} == {2, 3}
    assert "From confirmation seeds 2 to 3." in capsys.readouterr().out
    results = rows_of(tmp_path / "after" / "results.csv")
    assert {row["phase"] for row in results} == {"confirmation"}
    # What has been looked at stays what it was, however the file changes later.
    sitl.path.write_text(SMALL + "confirmation_seed: 1\n", encoding="utf-8")
    with pytest.raises(MixedRunsError, match="holds exploration runs"):
        sitl("--seeds", "1", "--first-seed", "1")
    sitl.path.write_text(SMALL + "confirmation_seed: 3\n", encoding="utf-8")
    with pytest.raises(MixedRunsError, match="other settings or seeds"):
        sitl("--seeds", "1", "--first-seed", "3", "--out", after)


def test_an_archive_remakes_what_a_document_has(sitl, tmp_path, capsys):
    folder = tmp_path / "evidence"
    page = folder / "page.md"
    folder.mkdir()
    table = folder / "small-table.csv"
    table.touch()
    marks = [f"<!-- begin small {what} -->\n<!-- end -->\n" for what in ("facts", "archive")]
    page.write_text("# Page\n" + "".join(marks), encoding="utf-8")
    archive = folder / "small-runs.jsonl.xz"
    sitl("--docs", str(page), "--archive", str(archive))
    size = sum(len(json.dumps(record)) for record in runs_in(tmp_path / "out"))
    assert archive.stat().st_size < size / 5
    text = page.read_text(encoding="utf-8")
    assert f"SHA-256 `{hashlib.sha256(archive.read_bytes()).hexdigest()}`" in text
    assert "12 runs (4 rows, exploration seeds 0 to 2)" in text
    # Later changes of the file and of its towns change nothing of what was archived.
    sitl.path.write_text("name: small\ntitle: Another\nrows: [{ugvs: 1}]\n", encoding="utf-8")

    capsys.readouterr()

    def verify():
        code, _ = sitl("--verify", str(page), experiment=archive)
        return code, capsys.readouterr().err

    assert verify() == (0, "small: 12 runs agree\n")
    page.write_text(text.replace("seeds 0 to 2", "seeds 0 to 3"), encoding="utf-8")
    table.write_text(table.read_text(encoding="utf-8").replace("runs", "ruins"), encoding="utf-8")
    code, err = verify()
    assert code == 1
    assert [line.partition(":")[0] for line in err.splitlines()] == [str(page), str(table)]
    assert "page.md: small facts: differs from the archived runs" in err
    page.write_text(text, encoding="utf-8")
    table.write_text("", encoding="utf-8")
    sitl("--docs", str(page), experiment=archive)
    assert verify()[0] == 0
    assert page.read_text(encoding="utf-8") == text
    with pytest.raises(UsageError, match="is about an archive"):
        sitl("--verify", str(page))
    (folder / "x.jsonl.xz").write_bytes(b"none")
    with pytest.raises(RunLogError, match="is no archive of runs"):
        sitl(experiment=folder / "x.jsonl.xz")


def test_runs_for_confirmation_have_blocks_of_their_own(sitl, tmp_path):
    page, archive = tmp_path / "page.md", tmp_path / "small-confirmation-runs.jsonl.xz"
    blocks = ["<!-- begin small facts -->\nexplored\n<!-- end -->\n"]
    page.write_text(blocks[0], encoding="utf-8")
    confirm = ("--seeds", "1", "--first-seed", "10001", "--docs", str(page))
    with pytest.raises(NoMarksError):
        sitl(*confirm)
    blocks.append("<!-- begin small-confirmation facts -->\n<!-- end -->\n")
    page.write_text("".join(blocks), encoding="utf-8")
    sitl(*confirm, "--archive", str(archive))
    text = page.read_text(encoding="utf-8")
    assert text.startswith(blocks[0])
    assert "confirmation seeds 10001 to 10001" in text
    assert sitl("--verify", str(page), experiment=archive)[0] == 0


def test_archived_seeds_are_made_again_whatever_the_declared_time_is(sitl, tmp_path, capsys):
    """Else no experiment with a stopping rule could be made again with later sources."""
    archive = tmp_path / "small-confirmation-runs.jsonl.xz"
    confirm = ("--first-seed", "10001", "--archive", str(archive))
    later = SMALL + "stop: {begin_before: 2999-01-01T00:00:00Z}\n"
    sitl.path.write_text(later, encoding="utf-8")
    sitl(*confirm, "--seeds", "2")
    sitl.path.write_text(later.replace("2999", "2020"), encoding="utf-8")
    _, pool = sitl(*confirm, "--seeds", "2", "--fresh")
    assert pool.made == []  # the rule is another one: these were never begun under it
    assert "the declared time is over" in capsys.readouterr().err
    experiment, _ = load_experiment(str(sitl.path))
    records = [made_up.work(task) for task in experiment.tasks(range(10001, 10003))]
    write_archive(archive, sitl.path, records)
    _, pool = sitl(*confirm, "--seeds", "3", "--fresh")
    assert {number for _, number in pool.made} == {10001, 10002}  # 10003 was never begun


def test_an_archive_stays_whole_when_the_disk_is_full(sitl, tmp_path):
    archive = tmp_path / "small-runs.jsonl.xz"
    experiment, _ = load_experiment(str(sitl.path))
    records = [made_up.work(task) for task in experiment.tasks(range(2))]
    write_archive(archive, sitl.path, records)
    before = archive.read_bytes()
    with files_of_at_most(100), pytest.raises(OSError, match="File too large"):
        write_archive(archive, sitl.path, records[:1])
    assert archive.read_bytes() == before
    assert list(tmp_path.glob(".small-runs*")) == []


def test_a_document_has_verdicts_on_exploration_seeds_in_a_line(sitl, tmp_path):
    part = "what: sooner, measure: goal_rate_area_percent, contrast: [{rows: {ugvs: 5}}]"
    claims = f"claims: [{{number: 1, text: More help., parts: [{{{part}, more_than: 1}}]}}]\n"
    sitl.path.write_text(SMALL + claims, encoding="utf-8")
    page, text = tmp_path / "page.md", ""
    for name in ("small", "small-confirmation"):
        for what in ("facts", "claims"):
            text += f"<!-- begin {name} {what} -->\n<!-- end -->\n"
    page.write_text(text, encoding="utf-8")
    (tmp_path / "small-claims.csv").touch()
    for first in ("0", "10001"):
        sitl("--docs", str(page), "--first-seed", first, "--out", str(tmp_path / first), out=False)
    explored, confirmed = re.findall(
        r"begin \S+ claims -->\n(.*?)\n<!--", page.read_text(), re.DOTALL
    )
    assert explored == "Claim 1 holds, on exploration seeds. [Numbers](small-claims.csv)."
    assert "| **1** | **More help.** | **holds** | |\n| | sooner | holds | +" in confirmed


def test_a_fault_of_the_model_is_reported_and_the_others_go_on(sitl, capsys):
    code, _ = sitl("--seeds", "2", work=made_up.failing_work)
    assert code == 1
    err = capsys.readouterr().err
    assert "5 m, 3 UGVs, seed 1 failed: the model's own fault" in err


def test_runs_of_another_version_are_reported(sitl, tmp_path, capsys):
    sitl("--seeds", "1")
    assert "other versions" not in capsys.readouterr().err
    path = tmp_path / "out" / "runs.jsonl"
    first, _, others = path.read_text().replace(program(), "0.0 of before").partition("\n")
    record = json.loads(first)
    del record["measures"]["service_age_mean_s"]  # which earlier versions did not have
    path.write_text(f"{json.dumps(record)}\n{others}", encoding="utf-8")
    sitl("--seeds", "1")
    err = capsys.readouterr().err
    assert "all 4 runs are there" in err
    assert "runs are from other versions of the program (0.0 of before; this is" in err


def test_what_would_be_in_vain_is_reported_before_the_first_run(sitl, tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Nothing\n", encoding="utf-8")
    pool = Here()
    tried = []

    def unfit(task):
        tried.append(task.row.label)
        if task.row.label == "30 m, 5 UGVs":
            raise UnfitSettingsError("no run can be made of it")

    sitl("--seeds", "2", "--rows", "ugvs=3")
    with pytest.raises(UnfitSettingsError):
        sitl("--seeds", "2", "--fresh", pool=pool, try_out=unfit)
    assert len(set(tried)) == len(tried)  # each row once
    assert len(runs_in(tmp_path / "out")) == 4  # --fresh has forgotten nothing yet
    with pytest.raises(NoMarksError, match="no place for 'small'"):
        sitl("--docs", str(page), pool=pool)
    assert pool.made == []


class Unlucky(Here):
    """Workers die: of one run once, of another for good."""

    def run(self, work, tasks, workers, may_begin):
        first, second, *others = tasks
        yield RunOutcome(first, None, "ended by SIGKILL", again=True)
        yield RunOutcome(second, None, "ended with code 1")
        yield from super().run(work, [first, *others], workers, may_begin)


def test_a_lost_run_is_reported(sitl, capsys):
    code, pool = sitl(pool=Unlucky())
    assert code == 1
    assert len(pool.made) == 11
    err = capsys.readouterr().err
    assert "5 m, 5 UGVs, seed 0 failed: ended by SIGKILL; it is begun again" in err
    assert "30 m, 5 UGVs, seed 0 failed: ended with code 1\n" in err


def test_results_are_tidy(sitl, tmp_path, capsys):
    sitl("--json")
    answer = json.loads(capsys.readouterr().out)
    rows = rows_of(tmp_path / "out" / "results.csv")
    assert len(rows) == answer["runs"] == 12
    ages = [row for row in rows_of(tmp_path / "out" / "ages.csv") if row["row"] == rows[0]["row"]]
    own = [row for row in ages if (row["seed_number"], row["topic"]) == ("0", "map")]
    assert {(row["maker"], row["user"]) for row in own} <= {
        ("uav01", f"ugv0{n}") for n in (1, 2, 3)
    }
    means = [float(row["age_mean_s"]) for row in own]
    assert np.mean(means) == pytest.approx(float(rows[0]["map_age_mean_s"]))
    assert rows[0]["radius_m"] == "5.0"
    assert rows[0]["timers.init_s"] == "99.0"
    assert (rows[0]["protocol"], rows[0]["uavs"]) == ("original", "1")  # which the file leaves out
    assert 0 <= float(rows[0]["goals_found_percent"]) <= 100
    assert answer["rows"][0]["row"] == "5 m, 3 UGVs"
    assert answer["rows"][0]["paper"]["wait_mean_s"] == 0.17
    columns = {name for name in rows[0] if name.split(".")[0] not in RunSettings.model_fields}
    page = (ROOT / "docs" / "evidence" / "experiments.md").read_text(encoding="utf-8")
    _, part, *_ = re.split("### The columns of the results|## The paper", page)
    heads = [line.split("|")[1] for line in part.splitlines() if line.startswith("| `")]
    assert set(re.findall(r"`(\w+)`", " ".join(heads))) == columns


def test_every_figure_is_drawn_and_a_document_gets_those_that_it_shows(sitl, tmp_path, monkeypatch):
    figures = pytest.importorskip("sitl.experiment.analysis.figures", exc_type=MissingExtraError)
    drawn = []

    def save(figure, png, pdf):
        """Without a layout, and small: sooner."""
        drawn.append((png.name, pdf.name))
        figure.set_layout_engine("none")
        figure.savefig(png, dpi=15)

    monkeypatch.setattr(figures, "save", save)
    page = tmp_path / "page.md"
    text = "# Title\n<!-- begin small facts -->\nold\n<!-- end -->\nkept\n"
    page.write_text(text + "![picture](images/small-goals.png)\n", encoding="utf-8")
    sitl("--seeds", "1", "--rows", "radius_m=5", "--docs", str(page), figures=True)
    names = ("compare", "goals", "bandwidth")
    assert drawn == [(f"{name}.png", f"{name}.pdf") for name in names]
    shown = (tmp_path / "images").iterdir()
    assert [path.name for path in shown] == ["small-goals.png"]
    assert re.search(r"begin small facts -->\n2 runs[^<]*<!-- end -->\nkept", page.read_text())
    assert not list(tmp_path.glob("small-*.csv"))


def test_a_figure_is_written_in_both_formats(tmp_path):
    sheet = pytest.importorskip("sitl.experiment.analysis.figures", exc_type=MissingExtraError)
    paths = tmp_path / "one.png", tmp_path / "one.pdf"
    sheet.save(sheet.sheet(1, "title", "subtitle")[0], *paths)
    assert [path.read_bytes()[:4] for path in paths] == [b"\x89PNG", b"%PDF"]


def test_the_cost_of_a_robot_is_drawn_over_teams_of_four_sizes_or_more():
    sheet = pytest.importorskip("sitl.experiment.analysis.figures", exc_type=MissingExtraError)
    experiment, _ = load_experiment("scale")
    records = [
        {"row": row.label, "measures": {"cpu_s": row.settings["ugvs"] ** 2 * 60e-3 + extra_s}}
        for row in experiment.rows
        for extra_s in (0, 12)
    ]
    (one,) = sheet.draw_cost(experiment, records).axes
    assert [line.get_label() for line in one.get_lines()] == ["paper", "path loss"]
    assert (one.get_xscale(), one.get_yscale()) == ("log", "log")
    for line in one.get_lines():
        expected = [[n + 2, (n * n + 100) / (n + 2)] for n in (5, 10, 20, 50, 100, 200, 500)]
        assert line.get_xydata() == pytest.approx(np.array(expected))
    three_sizes = records[:12]
    assert sheet.draw_cost(experiment, three_sizes) is None


def test_the_table_sums_up_messages_and_goals_not_runs(sitl, tmp_path):
    sitl("--rows", "ugvs=5", "radius_m=30")
    records = runs_in(tmp_path / "out")
    experiment, _ = load_experiment(str(sitl.path))
    (line,) = tables.lines(experiment, records)
    measures = [record["measures"] for record in records]
    waits = sum(m["waits"] for m in measures)
    mean_s = sum(m["waits"] * m["wait_mean_s"] for m in measures) / waits
    wait_s = line.values["wait_mean_s"]
    assert wait_s.value == pytest.approx(mean_s)
    assert wait_s.low <= mean_s <= wait_s.high
    assert line.values["broken"].value == np.mean([m["exchanges_broken"] for m in measures])
    own = sum(m["data_waits"] * m["data_wait_mean_s"] for m in measures)
    requests = sum(m["header_waits"] * m["header_wait_mean_s"] for m in measures)
    assert own + requests < mean_s * waits
    assert line.paper.goals_percent == 66.7
    assert "paper: goals %" not in tables.as_rows(experiment, [line])[0]  # it varies UAVs too
    whole, _ = load_experiment("table1")
    heads, cells = tables.as_rows(whole, [line])
    assert cells[heads.index("paper: goals %")] == "66.7"


def test_intervals_hold_their_share():
    chance = np.random.default_rng(5)
    inside = 0
    for _ in range(60):
        found = interval(chance.normal(3.0, 1.0, 8))
        inside += found.low <= 3.0 <= found.high
    assert inside >= 53  # 57 are to be expected
    assert math.isnan(interval(np.array([])).value)
    assert math.isnan(interval(np.array([1.0])).low)
    none = np.zeros(3)
    assert math.isnan(interval(none, none, statistic=ratio).low)  # no messages in any run
    assert interval(np.array([10.0, 0.0]), np.array([5.0, 0.0]), statistic=ratio).value == 2.0
    values, counts = np.array([1.0, 3.0, 8.0]), np.array([4.0, 1.0, 2.0])
    every = np.repeat(values, counts.astype(int))
    found = interval(values * counts, counts, values**2 * counts, statistic=spread)
    assert found.value == pytest.approx(every.std())


def test_what_there_is_can_be_listed(capsys):
    assert main(["experiment", "--list", "--json"]) == 0
    names = [each["name"] for each in json.loads(capsys.readouterr().out)]
    assert "table1" in names


def test_archived_runs_are_made_again_and_what_differs_is_listed(sitl, tmp_path, capsys):
    archive = tmp_path / "small-runs.jsonl.xz"
    sitl("--archive", str(archive))
    capsys.readouterr()

    def remake(work=made_up.work):
        code, _ = sitl("--remake", "2", "--json", experiment=archive, work=work)
        return code, json.loads(capsys.readouterr().out)

    code, results = remake()
    assert (code, [result["same"] for result in results]) == (0, [True, True])

    def another(task):
        made = made_up.work(task)
        measures = {**made["measures"], "goals_found": 999, "cpu_s": 1e9, "of_tomorrow": 1.0}
        return {**made, "digest": "another", "measures": measures}

    code, results = remake(another)
    assert code == 1
    assert [result["differing"] for result in results] == [["goals_found"]] * 2
    assert not any(result["same"] for result in results)

    def rounded(task):
        made = made_up.work(task)
        digits = {k: v * (1 + 4e-16) for k, v in made["measures"].items() if isinstance(v, float)}
        assert any(v != made["measures"][k] for k, v in digits.items())
        return {**made, "measures": {**made["measures"], **digits}}

    code, results = remake(rounded)  # another processor adds in another order
    assert (code, [result["same"] for result in results]) == (0, [True, True])

    def failing(task):
        raise FileNotFoundError(2, "No such file or directory", "town.yaml")

    code, results = remake(failing)
    assert (code, results[0]["why"]) == (1, "town.yaml: No such file or directory")
    with pytest.raises(UsageError, match="--remake is about an archive"):
        sitl("--remake", "2")


def test_an_archive_names_the_commit_and_the_lock_that_made_it(sitl, tmp_path):
    archive = tmp_path / "small-runs.jsonl.xz"
    sitl("--archive", str(archive))
    _, records = read_archive(archive)
    lock = hashlib.sha256((ROOT / "constraints.txt").read_bytes()).hexdigest()[:12]
    assert {record["dependencies"]["constraints"] for record in records} == {lock}
    commits = {record["commit"] for record in records}
    assert all(re.fullmatch(r"[0-9a-f]{12}\+?|unknown", commit) for commit in commits)


def test_parquet_has_what_the_csv_has_with_types(sitl, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    sitl.path.write_text(SMALL.replace("ugvs: [3, 5]", "battery: [none, 20]"), encoding="utf-8")
    sitl()
    table = parquet.read_table(tmp_path / "out" / "results.parquet")
    rows = rows_of(tmp_path / "out" / "results.csv")
    assert table.column_names == list(rows[0])
    assert table["goals_found"].to_pylist() == [int(row["goals_found"]) for row in rows]
    assert table["service_age_mean_s"].to_pylist() == [
        float(row["service_age_mean_s"]) for row in rows
    ]
    assert set(table["battery"].to_pylist()) == {"none", "20.0"}  # of two kinds, so text


def test_without_pyarrow_there_is_no_parquet(sitl, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert sitl()[0] == 0
    assert not (tmp_path / "out" / "results.parquet").exists()
    assert (tmp_path / "out" / "results.csv").exists()
