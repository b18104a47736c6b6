"""The check of what is simulated around a mission: its world file, its team, its rovers.

`sitl` reads these; it lies above this package, so it is asked as a program.
"""

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from air_router.errors import AirRouterError, ExitCode
from air_router.files import WORLD, notes
from mocha_link.team import Document, DocumentError, Problem


class WorldRefusedError(AirRouterError):
    """The mission's team, its world file, or a robot of `--rover` cannot be simulated."""

    exit_code = ExitCode.INVALID_FILE


class WorldUncheckedError(AirRouterError):
    """A package that the simulated world needs is not installed; the message says how to do it."""

    exit_code = ExitCode.MISSING_EXTRA


def world_notes(path: Path | None) -> tuple[Problem, ...]:
    """Notes on the numbers of a world file; none where it cannot be read, which is a problem."""
    if path is None:
        return ()
    try:
        return tuple(notes(Document.load(path), WORLD))
    except DocumentError:
        return ()


class WorldCheck:
    """Checks a mission's world file and team, in a process beside the caller's own work.

    Args:
        mission: The mission's file.
        rovers: Robots that the user's programs play, and where the node of each is served.
    """

    def __init__(self, mission: Path, rovers: Iterable[tuple[str, str]] = ()) -> None:
        words = [word for name, where in rovers for word in ("--rover", f"{name}={where}")]
        self._process = subprocess.Popen(  # noqa: S603 - our own program and arguments
            [sys.executable, "-m", "sitl", "team", str(mission), "--check", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def result(self) -> None:
        """Wait for its end.

        Raises:
            DocumentError: the world file is wrong: every problem, with line and column.
            WorldRefusedError: the team does not fit the mission, or has no such rover.
            WorldUncheckedError: an extra is missing.
        """
        stdout, stderr = self._process.communicate()
        if self._process.returncode == ExitCode.DONE:
            return
        if self._process.returncode == ExitCode.MISSING_EXTRA:
            raise WorldUncheckedError(stderr.strip())
        if stdout.strip():
            found = json.loads(stdout)["problems"]
            raise DocumentError(Problem(**each | {"path": Path(each["path"])}) for each in found)
        raise WorldRefusedError(stderr.strip())
