"""The states of a pull and its transitions: one table, which the docs print."""

from __future__ import annotations

import enum
from typing import Final


class PullState(enum.Enum):
    """The state of a pull; the value describes it in the docs."""

    OPENING = "no reply received: the peer may run an original or a new node"
    STANDING = "no reply received on the previous pull's connection, which may be lost"
    REFUSED = "the peer refused the sync, as original nodes do; its header list follows"
    ORIGINAL = "messages are received by the protocol of original nodes"
    SYNCING = "frames of the sync are received"
    FOLLOWING = "the pull has ended; the peer pushes or announces new messages"
    ENDED = "the pull has ended; nothing more is expected"
    BROKEN = "the pull was aborted; the next pull resumes it"


class PullEvent(enum.Enum):
    """An event of a pull; the value describes it in the docs."""

    BYTES = "bytes are received on the connection"
    FRAME = "a frame of the sync is received"
    REFUSAL = "SERRM is received"
    LIST = "a reply to GHEAD is received"
    FOLLOW = "everything is received, and the node follows the peer"
    END = "everything for this pull is received, and the node does not follow the peer"
    FAILURE = "time-out, lost connection, or other version of the sync"


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
"""Any other event leaves the state unchanged."""

OVER: Final = frozenset({_S.FOLLOWING, _S.ENDED, _S.BROKEN})
"""States of a pull that has ended or was aborted."""


def next_state(state: PullState, event: PullEvent) -> PullState:
    """The state of a pull after an event."""
    return STATES.get((state, event), state)
