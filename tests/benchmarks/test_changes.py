"""What is broken on purpose still is: every change applies to one place of the code of now."""

import pytest

from benchmarks.mutants import MUTANTS
from benchmarks.patched import Change, ChangeError, check
from benchmarks.sabotage.table import SABOTAGES
from benchmarks.stpa.__main__ import BREAKS
from sitl.rehearsal.faults import Fault


def misfits(changes):
    """What is wrong with them, by the names of what they break."""
    for name, of_it in changes:
        try:
            check(of_it)
        except ChangeError as error:
            yield f"{name}: {error}"


@pytest.mark.parametrize("new", ["return not_defined(cells)", "return cells for"])
def test_a_change_that_could_only_crash_is_no_change(new):
    old = "return header + cells.tobytes()"
    with pytest.raises(ChangeError, match=r"not_defined, defined nowhere|no Python"):
        check([Change("geo.grid", old, new)])


def test_every_mutant_applies():
    assert [*misfits((mutant.name, [mutant.change]) for mutant in MUTANTS)] == []


def test_every_sabotage_applies_and_its_scenes_are_flown():
    assert [*misfits((sabotage.name, sabotage.changes) for sabotage in SABOTAGES)] == []
    scenes = {scene.rsplit("-", 1)[0] for sabotage in SABOTAGES for scene in sabotage.scenes}
    assert scenes <= set(Fault.__members__)


def test_every_break_behind_the_table_of_unsafe_commands_applies():
    assert [*misfits((each.test, each.changes) for each in BREAKS)] == []
