"""The check of the simulated world around a mission: its world file, its team, its rovers.

`sitl` reads these; it lies above this package, so it runs as a program.
"""

import contextlib
import io
import json
import runpy
import sys
from collections.abc import Iterable
from pathlib import Path

from air_router.errors import AirRouterError, ExitCode
from air_router.files import WORLD, notes
from mocha_link.lifetime import INTERRUPTED, raise_when_interrupted
from mocha_link.team import Document, DocumentError, Problem


class WorldRefusedError(AirRouterError):
    """The mission's team, its world file, or a robot of `--rover` cannot be simulated."""

    exit_code = ExitCode.INVALID_FILE


class WorldUncheckedError(AirRouterError):
    """A package that the simulated world needs is not installed; the message has the command."""

    exit_code = ExitCode.MISSING_EXTRA


def world_notes(path: Path | None) -> tuple[Problem, ...]:
    """Notes on the numbers of a world file; none where it cannot be read, which is a problem."""
    if path is None:
        return ()
    try:
        return tuple(notes(Document.load(path), WORLD))
    except DocumentError:
        return ()


def check_world(mission: Path, rovers: Iterable[tuple[str, str]] = ()) -> None:
    """Check a mission's world file and team.

    `sitl` runs in this process: what takes a program its time at the start is loaded here.

    Args:
        mission: The mission's file.
        rovers: Robots that the user's programs play, and where the node of each is served.

    Raises:
        DocumentError: the world file is wrong: every problem, with line and column.
        WorldRefusedError: the team does not fit the mission, or has no such rover.
        WorldUncheckedError: an extra is missing.
        KeyboardInterrupt: the operator ends it.
    """
    options = [part for name, where in rovers for part in ("--rover", f"{name}={where}")]
    code, stdout, stderr = _sitl("team", str(mission), "--check", *options)
    if code == ExitCode.DONE:
        return
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    if code == ExitCode.MISSING_EXTRA:
        raise WorldUncheckedError(stderr.strip())
    if stdout.strip():
        found = json.loads(stdout)["problems"]
        raise DocumentError(Problem(**each | {"path": Path(each["path"])}) for each in found)
    raise WorldRefusedError(stderr.strip())


def _sitl(*options: str) -> tuple[int, str, str]:
    """Run the program; returns its exit code, and its stdout and stderr."""
    stdout, errors, argv = io.StringIO(), io.StringIO(), sys.argv
    sys.argv = ["sitl", *options]
    try:
        with contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(errors):
            runpy.run_module("sitl", run_name="__main__", alter_sys=False)
    except SystemExit as end:
        return int(end.code or ExitCode.DONE), stdout.getvalue(), errors.getvalue()
    finally:
        sys.argv = argv
        raise_when_interrupted()
    return ExitCode.DONE, stdout.getvalue(), errors.getvalue()
