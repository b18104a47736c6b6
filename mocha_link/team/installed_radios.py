"""The radios of other packages: entry points of the group `mocha_link.radios`, by URL scheme.

An entry point is a function ``(url: RadioUrl, team: Team, robot: Robot) -> Radio``. Here only the
schemes are known: `mocha_link.radios` loads a radio.
"""

from __future__ import annotations

from collections.abc import Container
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import Final

RADIO_GROUP: Final = "mocha_link.radios"


@lru_cache(maxsize=1)
def registered() -> dict[str, EntryPoint]:
    """All entry points of radios, by scheme, ours among them if they are installed."""
    return {entry.name: entry for entry in sorted(entry_points(group=RADIO_GROUP))}


def radios_of_others(ours: Container[str]) -> dict[str, EntryPoint]:
    """The entry points by scheme, without our schemes, even if another package registers one.

    Args:
        ours: the schemes of mocha_link's own radios.
    """
    return {name: entry for name, entry in registered().items() if name not in ours}
