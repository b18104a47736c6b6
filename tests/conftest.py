"""The suite gives the same answer every time; `HYPOTHESIS_PROFILE=explore` looks for new cases."""

import os

from hypothesis import settings

settings.register_profile("suite", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))

LONG = {"test_hostile.py", "test_days.py", "test_shortest_maps.py", "test_conformance.py"}


def pytest_collection_modifyitems(items):
    """The long ones first (`--no-loadscope-reorder` keeps it so): no core waits at the end."""
    items.sort(key=lambda item: "system" not in item.path.parts and item.path.name not in LONG)
