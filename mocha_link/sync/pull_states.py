"""The states of a pull, and what leads from one to the next: one table, which the docs print."""

from __future__ import annotations

import enum
from typing import Final


class PullState(enum.Enum):
    """What a pull waits for; the value says it for the docs."""

    OPENING = "nothing of the peer has come: it may be an original node or one of ours"
    STANDING = "the same over a connection that stood: it may be gone"
    REFUSED = "the peer refuses the sync, as original nodes do; its list comes next"
    ORIGINAL = "messages come in the protocol of original nodes"
    SYNCING = "frames of the sync come"
    FOLLOWING = "all has come; the peer pushes what it stores"
    ENDED = "nothing more is expected"
    BROKEN = "it broke off: the next pull resumes it"


class PullEvent(enum.Enum):
    """What may happen to a pull; the value says it for the docs."""

    BYTES = "bytes arrive on the connection"
    FRAME = "a frame of the sync arrives"
    REFUSAL = "SERRM arrives"
    LIST = "a reply to GHEAD arrives"
    FOLLOW = "all has come and we follow"
    END = "the peer has nothing more for this pull"
    FAILURE = "silence, a lost connection, another version"


_S, _E = PullState, PullEvent

STATES: Final[dict[tuple[PullState, PullEvent], PullState]] = {
    (_S.OPENING, _E.FRAME): _S.SYNCING,
    (_S.OPENING, _E.REFUSAL): _S.REFUSED,
    (_S.OPENING, _E.FAILURE): _S.BROKEN,
    (_S.STANDING, _E.BYTES): _S.SYNCING,
    (_S.STANDING, _E.FRAME): _S.SYNCING,
    (_S.STANDING, _E.FAILURE): _S.BROKEN,
    (_S.REFUSED, _E.LIST): _S.ORIGINAL,
    (_S.REFUSED, _E.FAILURE): _S.BROKEN,
    (_S.ORIGINAL, _E.END): _S.ENDED,
    (_S.ORIGINAL, _E.FAILURE): _S.BROKEN,
    (_S.SYNCING, _E.FOLLOW): _S.FOLLOWING,
    (_S.SYNCING, _E.END): _S.ENDED,
    (_S.SYNCING, _E.FAILURE): _S.BROKEN,
    (_S.FOLLOWING, _E.FAILURE): _S.BROKEN,
}
"""What is not in here changes nothing."""

OVER: Final = frozenset({_S.FOLLOWING, _S.ENDED, _S.BROKEN})
"""States of a pull that has ended or broken off."""


def next_state(state: PullState, event: PullEvent) -> PullState:
    """The state of a pull after an event."""
    return STATES.get((state, event), state)
