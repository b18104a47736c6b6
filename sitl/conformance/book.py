"""All conversations."""

from __future__ import annotations

from typing import Final

from sitl.conformance import (
    commands_book,
    failsafes_book,
    fences_book,
    flown_missions_book,
    links_book,
    missions_book,
    modes_book,
    offboard_book,
)

CONVERSATIONS: Final = (
    *commands_book.CONVERSATIONS,
    *modes_book.CONVERSATIONS,
    *missions_book.CONVERSATIONS,
    *flown_missions_book.CONVERSATIONS,
    *fences_book.CONVERSATIONS,
    *offboard_book.CONVERSATIONS,
    *links_book.CONVERSATIONS,
    *failsafes_book.CONVERSATIONS,
)
