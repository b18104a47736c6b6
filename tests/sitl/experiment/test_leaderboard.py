"""`sitl leaderboard`: the frozen test set, standings by scenario, and the table that keeps them."""

import csv
import json

import made_up
import pytest

from air_router.controller.targets import SeekPolicyError
from air_router.errors import ExitCode
from sitl.cli import leaderboard_command as command
from sitl.experiment.board import board, testset
from sitl.experiment.board.testset import ChangedSetError, entries, frozen_set
from sitl.experiment.campaign import put_together
from tests.command_lines import options_for
from tests.distributions import ROOT


def test_the_test_set_is_the_one_that_standings_are_of(monkeypatch):
    assert len(frozen_set().rows) == 12
    monkeypatch.setattr(testset, "FINGERPRINT", "000000000000")
    with pytest.raises(ChangedSetError, match="make another test set with a name of its own"):
        frozen_set()


def test_all_policies_meet_the_same_seeds():
    experiment = entries(frozen_set(), ("round_robin", "never", "tour"))
    tasks = [experiment.task(row, 20001) for row in experiment.rows]
    seeds = [task.seed for task in tasks]
    assert seeds[:12] == seeds[12:24] == seeds[24:]
    assert len(set(seeds)) == 12
    original = frozen_set()
    assert seeds[:12] == [original.task(row, 20001).seed for row in original.rows]
    passive = [row.settings.get("passive") for row in experiment.rows]
    assert passive == [None] * 12 + [True] * 12 + [None] * 12


@pytest.fixture
def sitl(tmp_path, monkeypatch):
    """Runs the command on made-up runs in this process."""
    work = {"make": made_up.work}

    def here(make, tasks, _jobs):
        for task in tasks:
            yield made_up_outcome(task, make)

    monkeypatch.setattr(command, "make_runs", here)

    def call(*options):
        arguments = options_for(command.run, *options, "--out", str(tmp_path / "out"))
        return command.run_with(arguments, work["make"])

    call.work = work
    return call


def made_up_outcome(task, make):
    from sitl.experiment.campaign.campaign import RunOutcome  # noqa: PLC0415

    return RunOutcome(task, make(task))


def slower(task):
    """As `made_up.work`, with half the age for tour, and a fault for rendezvous."""
    made = made_up.work(task)
    age_s = made["measures"]["service_age_mean_s"]
    if task.row.label.endswith(", tour"):
        measures = {**made["measures"], "service_age_mean_s": age_s / 2}
        return {**made, "measures": measures, "digest": "tour"}
    if task.row.label == "short range, rendezvous":
        return {**made, "faults": {"uav01": "ValueError: none"}}
    return made


def test_a_policy_is_compared_with_round_robin_by_scenario(sitl, tmp_path, capsys):
    sitl.work["make"] = slower
    table = tmp_path / "board.csv"
    assert sitl("tour", "--table", str(table)) == ExitCode.DONE
    out = capsys.readouterr().out
    assert "0.50 [0.50, 0.50]" in out
    with table.open() as file:
        rows = {row["policy"]: row for row in csv.DictReader(file)}
    assert rows.keys() == {"round_robin", "tour"}
    assert rows["tour"]["age_ratio"] == "0.50 [0.50, 0.50]"
    assert rows["tour"]["goals_gain_points"] == "+0.0 [+0.0, +0.0]"
    assert rows["round_robin"]["age_ratio"] == ""
    assert float(rows["tour"]["age_s"]) < float(rows["round_robin"]["age_s"])
    assert rows["tour"]["test_set"] == f"testset1 {testset.FINGERPRINT}"


def test_lines_of_other_policies_stay_and_a_moved_result_is_noted(sitl, tmp_path, capsys):
    table = tmp_path / "board.csv"
    sitl("freshest", "--table", str(table))
    first = {own.policy: own for own in board.read_board(table)}
    sitl.work["make"] = slower
    assert sitl("tour", "--table", str(table)) == ExitCode.DONE
    assert "have moved" not in capsys.readouterr().err
    both = {own.policy: own for own in board.read_board(table)}
    assert both.keys() == {"round_robin", "freshest", "tour"}
    assert both["freshest"] == first["freshest"]
    sitl.work["make"] = lambda task: {**made_up.work(task), "digest": "another"}
    sitl("tour", "--table", str(table), "--fresh")
    assert "note: results of tour have moved since" in capsys.readouterr().err
    table.write_text("a,b\n1,2\n")
    with pytest.raises(board.BoardError, match="has no standings"):
        sitl("tour", "--table", str(table))


def test_a_policy_that_fails_is_counted_and_the_exit_code_shows_it(sitl, capsys):
    sitl.work["make"] = slower
    assert sitl("rendezvous", "--json") == ExitCode.ENDED_OTHERWISE
    standings = {own["policy"]: own for own in json.loads(capsys.readouterr().out)}
    assert standings["rendezvous"]["failed"] == "1"
    assert standings["round_robin"]["failed"] == "0"


def test_the_shipped_table_is_of_the_frozen_set():
    standings = board.read_board(ROOT / "docs" / "evidence" / "leaderboard.csv")
    assert {own.test_set for own in standings} == {f"testset1 {testset.FINGERPRINT}"}
    assert {"round_robin", "never", "freshest", "rendezvous", "tour"} <= {
        own.policy for own in standings
    }
    assert {own.failed for own in standings} == {"0"}


def test_more_goals_come_first(tmp_path):
    shipped = board.read_board(ROOT / "docs" / "evidence" / "leaderboard.csv")
    path = tmp_path / "board.csv"
    board.write_board(path, shipped[::-1])
    goals = [float(own.goals_percent) for own in board.read_board(path)]
    assert goals == sorted(goals, reverse=True)
    assert path.read_text() == (ROOT / "docs" / "evidence" / "leaderboard.csv").read_text()
    policies = [line.split()[0] for line in board.table_text(shipped).splitlines()[1:]]
    assert policies == [own.policy for own in board.read_board(path)]


def test_a_policy_that_cannot_be_loaded_is_one_error_before_any_run(tmp_path, monkeypatch):
    def no_runs(*_):
        raise AssertionError("a run was begun")

    monkeypatch.setattr(command, "make_runs", no_runs)
    arguments = options_for(command.run, "no_such_package:Policy", "--out", str(tmp_path / "out"))
    with pytest.raises(SeekPolicyError, match=r"no_such_package.*add its folder to PYTHONPATH"):
        command.run_with(arguments, made_up.work, put_together)
