"""The browser that looks at pages: Debian's Chromium, best the one without windows."""

import shutil
from typing import Final

NAMES: Final = ("chromium-headless-shell", "chromium", "chromium-browser")


def chromium() -> str | None:
    """Its path; None where none is installed."""
    return next(filter(None, map(shutil.which, NAMES)), None)
