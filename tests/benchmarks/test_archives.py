"""`make experiments-remade`: the index of archives, and which of their runs are tried."""

import random

import pytest

from benchmarks import archives
from sitl.experiment.campaign import read_archive


def test_the_index_says_what_made_each_archive():
    text = archives.INDEX.read_text(encoding="utf-8")
    assert text == archives.index(archives.moved()), "python -m benchmarks.archives --index"


@pytest.fixture
def notes(monkeypatch, tmp_path):
    """An index of its own, in which only two small archives have no note."""
    tried = {"field", "crowd"}
    path = tmp_path / "archives.csv"
    path.write_text(
        archives.index({name: "moved" for name in archives.archives() if name not in tried}),
        encoding="utf-8",
    )
    monkeypatch.setattr(archives, "INDEX", path)
    return tried


def test_runs_of_archives_without_a_note_are_chosen_by_the_seed(notes):
    first, again = (archives.chosen(6, random.Random(3)) for _ in range(2))
    assert {experiment.name for experiment, _ in first} == notes
    assert [record["seed"] for _, record in first] == [record["seed"] for _, record in again]
    assert all(record["measures"]["cpu_s"] <= archives.LONGEST_CPU_S for _, record in first)
    other = archives.chosen(6, random.Random(4))
    assert [record["seed"] for _, record in first] != [record["seed"] for _, record in other]


def test_a_run_that_comes_out_otherwise_fails_the_check_and_says_how_to_go_on(
    notes, monkeypatch, capsys
):
    _, records = read_archive(archives.path_of("field"))
    kept = {(record["row"], record["number"]): record for record in records}

    def make(experiment, record):
        same = experiment.name != "field" or record in kept.values()
        return archives.Remade(f"{experiment.name} {record['number']}", same=same)

    monkeypatch.setattr(archives, "remade", make)
    assert archives.check(6, 3) == 0
    kept.clear()
    assert archives.check(6, 3) == 1
    said = capsys.readouterr()
    assert "table1: not tried, results have moved: moved" in said.out
    assert "--again field" in said.err
