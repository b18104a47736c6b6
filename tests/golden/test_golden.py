"""Every recorded stream of events leads to the decisions that it led to when it was recorded.

Where a change is meant to decide otherwise: see `tests.golden.record`.
"""

import pytest

from tests.golden.streams import FOLDER, SUFFIX, difference, read

NAMES = sorted(path.name.removesuffix(SUFFIX) for path in FOLDER.glob(f"*{SUFFIX}"))


@pytest.mark.parametrize("name", NAMES)
def test_the_decisions_are_those_that_were_recorded(name):
    found = difference(name, read(FOLDER / f"{name}{SUFFIX}"))
    assert found is None, f"\n{found}"
