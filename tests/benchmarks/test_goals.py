"""What `make bench-goals` prints and keeps, and the fleets that it lets live in simulated time."""

import importlib
import json
import math

import pytest

from benchmarks.fleet.simulated import clusters, neighbourhood
from benchmarks.goals import __main__ as command
from benchmarks.goals import page
from benchmarks.goals.figure import Figure
from benchmarks.goals.groups import GROUPS

DELAY = Figure("delay", 25.0, "ms", 20, anchors={"bare": 10.0, "none": 0.0})
SHARE = Figure("share", 95.0, "%", 92, at_least=True, anchors={"bare": 100.0})


def test_a_goal_is_met_at_most_or_at_least():
    assert (DELAY.met, SHARE.met, Figure("size", 1.0, "MB").met) == (False, True, None)
    assert Figure("never", math.inf, "s", 2).met is False


def test_each_anchor_has_its_ratio_and_a_missed_goal_is_printed():
    first, second = DELAY.lines()
    assert first.split() == ["delay,", "ms", "<=", "20", "25", "bare:", "10", "2.50", "MISSED"]
    assert second.split() == ["none:", "0", "-"]
    assert Figure("never", math.inf, "s", 2, anchors={"bare": 1.0}).as_row()["value"] is None


@pytest.fixture
def groups(monkeypatch):
    """In place of measuring: what each group brings, and which were requested."""
    requested = []

    def measured(name, conditions):
        requested.append((name, conditions.busy))
        return ([], "no browser") if name == "editing" else ([DELAY, SHARE], "")

    monkeypatch.setattr(command, "_measured", measured)
    return requested


def test_a_measurement_goes_on_where_it_was_left(groups, tmp_path, capsys):
    file = tmp_path / "goals.json"
    assert command.main(["--json", str(file), "--only", "routes", "--only", "editing"]) == 1
    assert "1 goals missed; editing not measured\n" in capsys.readouterr().out
    groups.clear()
    command.main(["--json", str(file), "--left", "--only", "routes", "--only", "links"])
    assert groups == [("links", False)]
    kept = json.loads(file.read_text())
    assert list(kept["idle"]) == ["routes", "links"]
    assert kept["idle"]["routes"]["figures"][0]["ratios"] == {"bare": 2.5, "none": None}


def test_what_was_measured_stands_in_the_page(groups, monkeypatch, tmp_path):
    monkeypatch.setattr(command, "busy_loops", command.contextlib.nullcontext)
    file, text = tmp_path / "goals.json", tmp_path / "goals.md"
    text.write_text(f"# Goals\n\n{page.BEGIN}old\n{page.END}\nmore\n")
    for options in ([], ["--busy"]):
        command.main(["--json", str(file), "--only", "routes", *options])
    assert groups == [("routes", False), ("routes", True)]
    command.main(["--json", str(file), "--docs", str(text)])
    written = text.read_text()
    assert "| delay, ms | ≤ 20 | **25** | **25** | bare: 2.50, 2.50; none: -, - |" in written
    assert "| share, % | ≥ 92 | 95 | 95 | bare: 0.95, 0.95 |" in written
    assert written.startswith("# Goals\n")
    assert written.endswith("\nmore\n")
    assert "old" not in written


def test_figures_of_the_smallest_sizes_are_not_quoted(groups, tmp_path):
    file, text = tmp_path / "goals.json", tmp_path / "goals.md"
    text.write_text(page.BEGIN + page.END)
    command.main(["--json", str(file), "--only", "routes", "--quick"])
    with pytest.raises(ValueError, match="--quick"):
        command.main(["--json", str(file), "--docs", str(text)])


@pytest.mark.parametrize("name", GROUPS)
def test_every_group_is_measured_by_the_module_of_its_name(name):
    assert callable(importlib.import_module(f"benchmarks.goals.{name}").measure)


def test_a_group_that_fails_reports_why():
    figures, why = command.figures_of("nothing", None)
    assert figures == []
    assert "No module named" in why


def test_a_message_reaches_a_neighbourhood_at_once_over_each_link_once():
    near = neighbourhood(4)
    assert len(near.spread_s) == 4 * 3
    assert near.spread_s[-1] == pytest.approx(0.01)
    assert (near.per_link, near.copies) == (1, 1.0)
    assert near.empty_sync_ms > 0


def test_a_mule_takes_a_message_from_cluster_to_cluster():
    far = clusters(10)
    assert len(far.spread_s) == 9
    assert far.spread_s[-1] < 0.1
    assert (far.per_link, far.copies) == (1, 1.0)
