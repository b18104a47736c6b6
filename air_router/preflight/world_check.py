"""Checks the simulated world of a mission: world file, team, rovers.

`sitl` reads these; it depends on this package, so it is run as a program.
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
    """Notes on the values of a world file; none if it cannot be read (a separate problem)."""
    if path is None:
        return ()
    try:
        return tuple(notes(Document.load(path), WORLD))
    except DocumentError:
        return ()


def check_world(mission: Path, rovers: Iterable[tuple[str, str]] = ()) -> None:
    """Check a mission's world file and team.

    `sitl` runs in this process, which has loaded its slow imports already.

    Args:
        mission: The mission file.
        rovers: Robots played by the user's programs, with each node's endpoint.

    Raises:
        DocumentError: The world file has errors; contains all, with line and column.
        WorldRefusedError: The team does not fit the mission, or has no such rover.
        WorldUncheckedError: An extra is missing.
        KeyboardInterrupt: The operator interrupts it.
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
    """Run the program; return exit code, stdout and stderr."""
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
