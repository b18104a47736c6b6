"""The states of a pull as its serving side sees it: one table, which the docs print."""

from __future__ import annotations

import enum
from typing import Final


class SendState(enum.Enum):
    """What a served pull waits for; the value says it for the docs."""

    OPENING = "the peer has not opened"
    REJECTED = "OPEN is of another version: HELLO says so, and nothing else goes out"
    WAITING = "HELLO asks for another OPEN: the list or the configuration is not known"
    SENDING = "messages go out"
    DONE = "all went out, DONE last: the peer says how it goes on"
    CUT_SHORT = "the same, but the budget was too small for all"
    FOLLOWED = "the pull has ended; what is stored goes out at once"
    OVER = "nothing more goes out"


class SendEvent(enum.Enum):
    """What may happen to a served pull; the value says it for the docs."""

    UNREADABLE = "OPEN of another version arrives"
    UNKNOWN = "OPEN arrives, and what it refers to is not known"
    OPEN = "OPEN arrives"
    ALL_SENT = "no message is left to send"
    BUDGET_SPENT = "no more fits in the budget"
    FOLLOW = "FOLLOW arrives"
    END = "END, silence, a new pull of the peer"


_S, _E = SendState, SendEvent

STATES: Final[dict[tuple[SendState, SendEvent], SendState]] = {
    (_S.OPENING, _E.UNREADABLE): _S.REJECTED,
    (_S.OPENING, _E.UNKNOWN): _S.WAITING,
    (_S.OPENING, _E.OPEN): _S.SENDING,
    (_S.OPENING, _E.FOLLOW): _S.OVER,
    (_S.OPENING, _E.END): _S.OVER,
    (_S.REJECTED, _E.UNKNOWN): _S.WAITING,
    (_S.REJECTED, _E.OPEN): _S.SENDING,
    (_S.REJECTED, _E.FOLLOW): _S.OVER,
    (_S.REJECTED, _E.END): _S.OVER,
    (_S.WAITING, _E.UNREADABLE): _S.REJECTED,
    (_S.WAITING, _E.OPEN): _S.SENDING,
    (_S.WAITING, _E.FOLLOW): _S.OVER,
    (_S.WAITING, _E.END): _S.OVER,
    (_S.SENDING, _E.UNREADABLE): _S.REJECTED,
    (_S.SENDING, _E.UNKNOWN): _S.WAITING,
    (_S.SENDING, _E.ALL_SENT): _S.DONE,
    (_S.SENDING, _E.BUDGET_SPENT): _S.CUT_SHORT,
    (_S.SENDING, _E.FOLLOW): _S.OVER,
    (_S.SENDING, _E.END): _S.OVER,
    (_S.DONE, _E.UNREADABLE): _S.REJECTED,
    (_S.DONE, _E.UNKNOWN): _S.WAITING,
    (_S.DONE, _E.OPEN): _S.SENDING,
    (_S.DONE, _E.FOLLOW): _S.FOLLOWED,
    (_S.DONE, _E.END): _S.OVER,
    (_S.CUT_SHORT, _E.UNREADABLE): _S.REJECTED,
    (_S.CUT_SHORT, _E.UNKNOWN): _S.WAITING,
    (_S.CUT_SHORT, _E.OPEN): _S.SENDING,
    (_S.CUT_SHORT, _E.FOLLOW): _S.OVER,
    (_S.CUT_SHORT, _E.END): _S.OVER,
    (_S.FOLLOWED, _E.UNREADABLE): _S.REJECTED,
    (_S.FOLLOWED, _E.END): _S.OVER,
}
"""What is not in here changes nothing."""

ENDED: Final = frozenset({_S.FOLLOWED, _S.OVER})
"""States of a pull that has ended."""

GIVEN_OUT: Final = frozenset({_S.DONE, _S.CUT_SHORT}) | ENDED
"""States in which all that the pull is given has gone out."""


def next_state(state: SendState, event: SendEvent) -> SendState:
    """The state of a served pull after an event."""
    return STATES.get((state, event), state)
