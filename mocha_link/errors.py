"""The root of the package's errors; each cause has its own class in the module that finds it.

Extras are packages that only some features need: here is what is missing, and how to install it.
A `Guard` keeps an error that is a mistake of ours from ending more than what it happened in.
"""

from __future__ import annotations

import json
import logging
import math
import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Final
from urllib.parse import unquote, urlsplit

MISSING_EXTRA: Final = 7
"""The exit code of a command that lacks a package."""

_FOLDERS: Final = {"mocha-link": "./packaging/mocha-link", "air-router": "."}
"""Where the distributions stand in the project's folder."""

_OURS: Final = ("mocha_link", "air_router", "geo", "sitl")


GUARD_LOG_S: Final = 10.0
"""An error that comes again and again is logged at this distance."""

LOG = logging.getLogger("mocha_link")


class MochaLinkError(Exception):
    """Anything that mocha_link reports: the message says what, where, and what to do."""


class NotInTeamError(MochaLinkError):
    """A caller names what the team does not have: of a command, wrong usage."""


class RequestError(MochaLinkError):
    """A request that is none, or cannot be done. `again`: the same may be taken later."""

    def __init__(self, message: str, *, again: bool = False) -> None:
        super().__init__(message)
        self.again = again


class RadioError(MochaLinkError):
    """A radio that cannot be used, or a report that is none."""


class PortInUseError(MochaLinkError):
    """A port that the node needs is taken by another process or node."""


class ListenError(MochaLinkError):
    """A port or address on which the node cannot listen for another reason."""


class MissingExtraError(MochaLinkError):
    """A package of an extra is not installed; the message has the command that installs it.

    Args:
        what: Needs it, as the subject of a sentence.
        package: What is missing.
        extra: The extra that has it.
        distribution: Whose extra that is.
    """

    def __init__(
        self, what: str, package: str, extra: str, distribution: str = "mocha-link"
    ) -> None:
        super().__init__(
            f"{what} needs {package}, which is not installed; "
            f"run: {install_command(extra, distribution)}"
        )


def error_text(error: Exception) -> str:
    """An expected error as the message that ends a command."""
    if isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename is not None else ""
        return f"{place}{error.strerror or str(error) or type(error).__name__}"
    return str(error)


@contextmanager
def needs_extra(what: str, extra: str, distribution: str = "mocha-link") -> Iterator[None]:
    """Where modules are imported that need an extra.

    Raises:
        MissingExtraError: one of their packages is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or str(error)).split(".")[0]
        if package in _OURS:
            raise
        raise MissingExtraError(what, package, extra, distribution) from None


def install_command(extra: str, distribution: str = "mocha-link") -> str:
    """What adds an extra to a distribution: from its checkout or wheel, else its packages."""
    from importlib import metadata  # noqa: PLC0415 - half of what a command's start would take

    try:
        found = metadata.distribution(distribution)
    except metadata.PackageNotFoundError:  # run from the sources
        return f"pip install '{_FOLDERS[distribution]}[{extra}]' (in the project's folder)"
    origin = json.loads(found.read_text("direct_url.json") or "{}")
    path = Path(unquote(urlsplit(origin.get("url", "")).path))
    if not path.is_absolute() or not path.exists():  # a wheel among others, or gone
        needs = (each.replace('"', "'").split(";") for each in found.requires or ())
        names = [
            shlex.quote(name) for name, *when in needs if f"extra == '{extra}'" in "".join(when)
        ]
        return f"pip install {' '.join(names)}"
    editable = "-e " if origin.get("dir_info", {}).get("editable") else ""
    return f"pip install {editable}{shlex.quote(f'{path}[{extra}]')}"


class Guard:
    """Around what may fail by a mistake of ours: nothing that comes from outside may end the rest.

    For ``with``, in one thread. An error ends there and is logged with its traceback: the first
    one at once, of those that follow one in `GUARD_LOG_S` with how many there were.

    Args:
        what: What goes on all the same, as the beginning of a line in the log.
        clock: Steady seconds.

    Attributes:
        errors: So many have ended here.
    """

    def __init__(self, what: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.errors = 0
        self._what = what
        self._clock = clock
        self._due_s = -math.inf  # when the next one is logged
        self._logged = 0  # `errors` at the last one

    def __enter__(self) -> None:
        pass

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        if not isinstance(error, Exception):
            return False
        self.errors += 1
        now_s = self._clock()
        if now_s >= self._due_s:
            self._due_s = now_s + GUARD_LOG_S
            count = self.errors - self._logged
            times = f" ({count} since the last one)" if count > 1 else ""
            LOG.error("%s%s", self._what, times, exc_info=error)
            self._logged = self.errors
        return True
