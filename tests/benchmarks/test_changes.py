"""What is broken on purpose still is: every change applies to one place of the code of now."""

import pytest

from benchmarks.mutants import MUTANTS
from benchmarks.patched import check
from benchmarks.sabotage.table import SABOTAGES
from sitl.rehearsal.faults import Fault


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_a_mutant_applies(mutant):
    check([mutant.change])


@pytest.mark.parametrize("sabotage", SABOTAGES, ids=lambda sabotage: sabotage.name)
def test_a_sabotage_applies_and_its_scenes_are_flown(sabotage):
    check(sabotage.changes)
    assert {scene.rsplit("-", 1)[0] for scene in sabotage.scenes} <= set(Fault.__members__)
