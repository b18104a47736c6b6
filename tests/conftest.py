"""The suite gives the same answer every time; `HYPOTHESIS_PROFILE=explore` looks for new cases."""

import gc
import os
import signal
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers

from tests.loopback_dds import CONFIG

settings.register_profile("suite", derandomize=True, deadline=None, max_examples=25)
settings.register_profile("explore", deadline=None, max_examples=1000)
PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "suite")
settings.load_profile(PROFILE)
if PROFILE == "suite":
    # Else examples have constants of all modules that the process happens to have imported, and
    # it parses every one of them for that.
    providers._get_local_constants = lambda: providers._local_constants

# What a shell starts in the background ignores Ctrl-C, and so would all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Flights are recorded below the user's state unless told otherwise; those of the tests are not.
_STATE = tempfile.TemporaryDirectory(prefix="air-router-tests-")
os.environ["XDG_STATE_HOME"] = _STATE.name

PATIENT = {"test_found_faults.py", "test_px4_commands.py", "test_px4_acknowledgements.py"}
"""Waits most of its time."""

LONG = {"test_hostile.py", "test_soak.py", "test_shortest_maps.py", "test_conformance.py"}
LANES = (
    ("test_fly.py", "test_preflight.py", "test_px4.py", "test_sim_px4.py"),
    ("test_rovers.py", "test_hostile_flight.py", "test_several.py", "test_whole_flight.py"),
)
"""Of tests/system: vehicles fly in real time or faster, two at a time and no more.

Those with a browser follow one another: one browser is begun for all of them.
"""

PAGES = ("test_edit_page.py", "test_map_pages.py", "test_report_page.py")
"""Of tests/system: the same for pages without a flight."""

FLIGHTS = {name: place for lane in LANES for place, name in enumerate(lane)}


def _flies(file):
    return file.parent.name == "system" and file.name in FLIGHTS


def pytest_collection_modifyitems(items):
    """The long ones first (`--no-loadscope-reorder` keeps it so): no core waits at the end.

    Who drives a browser is marked; flights are not, also where a browser looks on.
    """
    for item in items:
        if "browser" in item.fixturenames and not _flies(item.path):
            item.add_marker("browser")

    def rank(item):
        if _flies(item.path) or item.path.name in PATIENT:
            return 0, FLIGHTS.get(item.path.name, 0)
        return (1 if item.path.parent.name == "system" or item.path.name in LONG else 2), 0

    items.sort(key=rank)


gc.disable()


def pytest_collection_finish():
    """Thousands of tests stay: the garbage collector need not look at them again and again."""
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Every file stays on one worker, as with `--dist loadfile`; the flights on two, pages on one.

    So do the single orders, which take long and leave the processor to the others.
    """
    from xdist.scheduler import LoadFileScheduling  # noqa: PLC0415 - there if it asks for this

    class TwoFlightsAtATime(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = Path(super()._split_scope(nodeid))
            if file.parent.name == "system":
                for n, lane in enumerate((*LANES, PAGES)):
                    if file.name in lane:
                        return f"lane {n}"
            return str(file.parent if file.parent.name == "orders" else file)

    return TwoFlightsAtATime(config, log)


@pytest.fixture
def domain(monkeypatch):
    """The number of a DDS domain on the loopback interface, unlike that of other runs."""
    monkeypatch.setenv("CYCLONEDDS_URI", CONFIG)
    return 100 + os.getpid() % 130
