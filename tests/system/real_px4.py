"""Real PX4s for tests: those that PX4_SITL names, one per version; else one found otherwise."""

import contextlib
import json
import os
import subprocess
import sys

import pytest

from sitl.process.px4_install import NoPx4Error, find_px4, named
from tests.system.conftest import environment

PLACES = [pytest.param(place, id=place.rpartition("/")[2] or "PATH") for place in named(os.environ)]
PLACES = PLACES or [pytest.param("", id="PATH")]


def found(place):
    """The PX4 at a place, or the one that is found otherwise; without it the test is skipped."""
    try:
        return find_px4(place or None)
    except NoPx4Error as error:
        pytest.skip(str(error).splitlines()[0])


def named_by(place):
    """The options of `sitl px4` and `air-router sim` that name it."""
    return ["--px4", place] if place else []


@contextlib.contextmanager
def started(folder, *arguments):
    """A process of `sitl`, and its line when it is ready; its log is beside it."""
    with (
        (folder / "sitl.log").open("wb") as log,
        subprocess.Popen(
            [sys.executable, "-m", "sitl", *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=log,
            cwd=folder,
            env=environment(),
        ) as process,
    ):
        try:
            yield json.loads(process.stdout.readline())
        finally:
            process.terminate()
