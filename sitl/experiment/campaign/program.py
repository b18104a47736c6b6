"""Which program made a run: other code may make other runs of the same seed."""

from __future__ import annotations

import functools
import hashlib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

_ROOT: Final = Path(__file__).parents[3]
_PACKAGES: Final = ("air_router", "geo", "mocha_link", "sitl")


@functools.cache
def program() -> str:
    """The version and a hash of the program's own sources: other code may make other runs."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((_ROOT / package).rglob("*.py")):
            digest.update(path.relative_to(_ROOT).as_posix().encode())
            digest.update(path.read_bytes())
    try:
        number = version("air-router")
    except PackageNotFoundError:
        number = "unknown"
    return f"{number} {digest.hexdigest()[:12]}"
