"""The suite gives the same answer every time; `HYPOTHESIS_PROFILE=explore` looks for new cases."""

import gc
import os
import signal
import tempfile

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

# Flights are recorded below the user's state by default; those of the tests are not.
_STATE = tempfile.TemporaryDirectory(prefix="air-router-tests-")
os.environ["XDG_STATE_HOME"] = _STATE.name


def _group(item):
    """The tests that stay on one worker, beside those of its file: vehicles fly two at a time."""
    mark = item.get_closest_marker("xdist_group")
    return mark.args[0] if mark else ""


def pytest_collection_modifyitems(items):
    """The long ones first (`--no-loadscope-reorder` keeps it so): no core waits at the end.

    Who drives a browser is marked; flights are not, also where a browser looks on.
    """
    for item in items:
        if "browser" in item.fixturenames and not _group(item).startswith("flights"):
            item.add_marker("browser")

    def rank(item):
        if _group(item).startswith("flights") or item.get_closest_marker("patient"):
            return 0
        return 1 if item.path.parent.name == "system" or item.get_closest_marker("long") else 2

    items.sort(key=rank)


gc.disable()


def pytest_collection_finish():
    """Thousands of tests stay: the garbage collector need not look at them again and again."""
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Every file stays on one worker, and so does every group (`--dist loadgroup`)."""
    from xdist.scheduler import LoadGroupScheduling  # noqa: PLC0415 - there where this hook runs

    class FilesAndGroups(LoadGroupScheduling):
        def _split_scope(self, nodeid):
            return super()._split_scope(nodeid).partition("::")[0]

    return FilesAndGroups(config, log)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """By its own name, without the group: `--last-failed` finds it again without workers too."""
    report = yield
    report.nodeid = report.nodeid.removesuffix(f"@{_group(item)}")
    return report


@pytest.fixture
def domain(monkeypatch):
    """The number of a DDS domain on the loopback interface, unlike that of other runs."""
    monkeypatch.setenv("CYCLONEDDS_URI", CONFIG)
    return 100 + os.getpid() % 130
