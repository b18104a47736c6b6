"""The root of the package's errors; each cause has its own class in the module that finds it.

Extras are packages that only some features need. `needs_extra` names the missing package and the
command that installs it. A `Guard` limits an unexpected error to the operation that raised it.
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
from typing import Any, Final
from urllib.parse import unquote, urlsplit

MISSING_EXTRA: Final = 7
"""The exit code of a command that lacks a package."""

_FOLDERS: Final = {"mocha-link": "./packaging/mocha-link", "air-router": "."}
"""Where each distribution is in the project's folder."""

_OURS: Final = ("mocha_link", "air_router", "geo", "sitl")


GUARD_LOG_S: Final = 10.0
"""The shortest time between two log lines of an error that recurs."""

LOG = logging.getLogger("mocha_link")


class MochaLinkError(Exception):
    """Any error that mocha_link reports: the message names the cause, the place and the remedy."""


class NotInTeamError(MochaLinkError):
    """A name that the team does not have; in a command line, wrong usage."""


class RequestError(MochaLinkError):
    """An invalid request, or one that cannot be executed. `again`: it may succeed later."""

    def __init__(self, message: str, *, again: bool = False) -> None:
        super().__init__(message)
        self.again = again


class RadioError(MochaLinkError):
    """A radio that cannot be used, or an invalid report."""


class PortInUseError(MochaLinkError):
    """Another process or node has a port that the node needs."""


class ListenError(MochaLinkError):
    """A port or address on which the node cannot listen for another reason."""


class MissingExtraError(MochaLinkError):
    """A package of an extra is not installed; the message has the command that installs it.

    Args:
        what: the feature that needs it, as the subject of a sentence.
        package: the missing package.
        extra: the extra that contains it.
        distribution: the distribution that has the extra.
    """

    def __init__(
        self, what: str, package: str, extra: str, distribution: str = "mocha-link"
    ) -> None:
        super().__init__(
            f"{what} needs {package}, which is not installed; "
            f"run: {install_command(extra, distribution)}"
        )


def error_text(error: Exception) -> str:
    """The text of an expected error, as a command prints it.

    Args:
        error: the error; an OSError is printed as path and reason.
    """
    if isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename is not None else ""
        return f"{place}{error.strerror or str(error) or type(error).__name__}"
    return str(error)


@contextmanager
def needs_extra(what: str, extra: str, distribution: str = "mocha-link") -> Iterator[None]:
    """A context for imports that need an extra.

    Args:
        what: the feature, as the subject of a sentence.
        extra: the extra that contains the packages.
        distribution: the distribution that has the extra.

    Raises:
        MissingExtraError: one of the packages is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or str(error)).split(".")[0]
        if package in _OURS:
            raise
        raise MissingExtraError(what, package, extra, distribution) from None


def install_command(extra: str, distribution: str = "mocha-link") -> str:
    """The command that installs an extra: from the checkout or wheel, else by package names.

    Args:
        extra: the name of the extra.
        distribution: the distribution that has it.
    """
    from importlib import metadata  # noqa: PLC0415 - half of what a command's start would take

    try:
        found = metadata.distribution(distribution)
    except metadata.PackageNotFoundError:  # run from the sources
        return f"pip install '{_FOLDERS[distribution]}[{extra}]' (in the project's folder)"
    origin = json.loads(found.read_text("direct_url.json") or "{}")
    path = Path(unquote(urlsplit(origin.get("url", "")).path))
    if not path.is_absolute() or not path.exists():  # an installed wheel, or a removed path
        needs = (each.replace('"', "'").split(";") for each in found.requires or ())
        names = [
            shlex.quote(name) for name, *when in needs if f"extra == '{extra}'" in "".join(when)
        ]
        return f"pip install {' '.join(names)}"
    editable = "-e " if origin.get("dir_info", {}).get("editable") else ""
    return f"pip install {editable}{shlex.quote(f'{path}[{extra}]')}"


class Guard:
    """Limits an unexpected error: input from outside must not end other work.

    Use it in ``with``, in one thread. The guard logs an error with its traceback: the first one at
    once, later ones at most every `GUARD_LOG_S` seconds with their number.

    Args:
        what: the work that continues, as the beginning of the log line.
        clock: steady seconds.
        log: where it logs.

    Attributes:
        errors: the number of errors so far.
    """

    def __init__(
        self,
        what: str,
        clock: Callable[[], float] = time.monotonic,
        log: logging.Logger | logging.LoggerAdapter[Any] = LOG,
    ) -> None:
        self.errors = 0
        self._what = what
        self._log = log
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
            self._log.error("%s%s", self._what, times, exc_info=error)
            self._logged = self.errors
        return True
