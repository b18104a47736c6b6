"""All conversations."""

from __future__ import annotations

from typing import Final

from sitl.conformance.cases import (
    commands as commands_book,
)
from sitl.conformance.cases import (
    failsafes as failsafes_book,
)
from sitl.conformance.cases import (
    fences as fences_book,
)
from sitl.conformance.cases import (
    flown_missions as flown_missions_book,
)
from sitl.conformance.cases import (
    links as links_book,
)
from sitl.conformance.cases import (
    missions as missions_book,
)
from sitl.conformance.cases import (
    modes as modes_book,
)
from sitl.conformance.cases import (
    offboard as offboard_book,
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
