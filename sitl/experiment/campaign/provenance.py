"""What a run was made by: the program's sources, their commit, and the packages under them.

Whoever has these makes the run again: `git switch --detach COMMIT`, `make setup`, and the archive.
"""

from __future__ import annotations

import functools
import hashlib
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

_ROOT: Final = Path(__file__).parents[3]
_PACKAGES: Final = ("air_router", "geo", "mocha_link", "sitl")
_DATA: Final = "missions"
"""Beside the packages, what a run of a checkout is made of."""

_COUNTED: Final = ("numpy", "pydantic", "pyproj", "scipy", "shapely")
"""Packages that compute something of a run."""

UNKNOWN: Final = "unknown"


@functools.cache
def program() -> str:
    """The version and a hash of the program's own sources: other code may make other runs."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((_ROOT / package).rglob("*.py")):
            digest.update(path.relative_to(_ROOT).as_posix().encode())
            digest.update(path.read_bytes())
    return f"{_version('air-router')} {digest.hexdigest()[:12]}"


@functools.cache
def commit() -> str:
    """The checkout's commit, with `+` if its sources differ from it; `unknown` outside of one."""
    if not (_ROOT / ".git").exists():
        return UNKNOWN
    found, changed = _git("rev-parse", "HEAD"), _git("status", "--porcelain", "--", *_MADE_OF)
    if not found or changed is None:
        return UNKNOWN
    return f"{found[:12]}{'+' if changed else ''}"


@functools.cache
def dependencies() -> tuple[tuple[str, str], ...]:
    """The lock's hash (`constraints.txt`), and versions that count: (name, value) each."""
    lock = _ROOT / "constraints.txt"
    locked = hashlib.sha256(lock.read_bytes()).hexdigest()[:12] if lock.is_file() else UNKNOWN
    versions = [("python", platform.python_version()), *((n, _version(n)) for n in _COUNTED)]
    return (("constraints", locked), *versions)


_MADE_OF: Final = (*(f":(glob){package}/**/*.py" for package in _PACKAGES), _DATA)


def _git(*arguments: str) -> str | None:
    """What git prints; None: there is no git, or it refuses."""
    try:
        done = subprocess.run(  # noqa: S603 - arguments of ours
            ["git", "-C", str(_ROOT), *arguments],  # noqa: S607 - the user's own git
            capture_output=True,
            text=True,
            check=True,
            timeout=30,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return UNKNOWN
