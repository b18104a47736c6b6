"""`make experiments-remade`: the index of archives, and which of their runs are tried."""

import random
import re

import pytest

from benchmarks import archives
from sitl.experiment import experiment_names, load_experiment
from sitl.experiment.campaign import read_archive


def test_the_index_states_what_made_each_archive():
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


def test_a_run_with_another_result_fails_the_check_which_prints_how_to_go_on(
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
    printed = capsys.readouterr()
    assert "table1: not tried, results have moved: moved" in printed.out
    assert "--again field" in printed.err


def test_the_page_has_every_declared_claim_once_and_in_order():
    page = archives.PAGE.read_text(encoding="utf-8")
    table = page.partition("<!-- begin all claims -->")[2].partition("<!-- end -->")[0]
    listed = [int(number) for number in re.findall(r"^\| (\d+) \|", table, re.MULTILINE)]
    declared = {
        claim.number for name in experiment_names() for claim in load_experiment(name)[0].claims
    }
    assert listed == sorted(declared)


def test_claims_are_decided_by_archives_and_lead_to_their_sections():
    page = "# Page\n## The link: `radio`\n<!-- begin radio-confirmation claims -->\n<!-- end -->\n"
    table = archives.claims_text(["radio-confirmation", "crowd"], page)
    by_number = {line.split("|")[1].strip(): line for line in table.splitlines()}
    line = by_number["13"]
    assert line.startswith("| 13 | With the link that 3GPP says a UAV has")
    assert "| **not run yet** |" in by_number["14"]  # its archive is not among these
    assert "| **holds** | 0.11 times [" in line
    assert "; first of 3 parts | [`radio`](#the-link-radio) |" in line
    whole = f"top\n<!-- begin all claims -->\nold\n<!-- end -->\n{page}"
    assert archives.with_claims(whole, table) == whole.replace("old", table)
    with pytest.raises(ValueError, match="begin all claims"):
        archives.with_claims(page, table)
