"""The states of a pull on its serving side: one table, which the docs print."""

from __future__ import annotations

import enum
from typing import Final


class SendState(enum.Enum):
    """The state of a served pull; the value describes it in the docs."""

    OPENING = "no OPEN received"
    REJECTED = "OPEN has another version: HELLO reports it, and nothing else is sent"
    WAITING = "HELLO requested another OPEN: the list or the configuration is unknown"
    SENDING = "messages are sent"
    DONE = "all messages and DONE are sent: the peer replies with FOLLOW, END or OPEN"
    CUT_SHORT = "the budget is used up, and DONE is sent: the peer replies likewise"
    FOLLOWED = "the pull has ended; newly stored messages are pushed or announced"
    OVER = "nothing more is sent"


class SendEvent(enum.Enum):
    """An event of a served pull; the value describes it in the docs."""

    UNREADABLE = "OPEN of another version is received"
    UNKNOWN = "OPEN is received and refers to an unknown list or configuration"
    OPEN = "OPEN is received"
    ALL_SENT = "no message is left to send"
    BUDGET_SPENT = "no message fits in the rest of the budget"
    FOLLOW = "FOLLOW is received"
    END = "END is received, the peer is silent, or it begins a new pull"


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
"""Any other event leaves the state unchanged."""

ENDED: Final = frozenset({_S.FOLLOWED, _S.OVER})
"""States of a pull that has ended."""

ALL_SENT: Final = frozenset({_S.DONE, _S.CUT_SHORT}) | ENDED
"""States in which all messages for the pull have been sent."""


def next_state(state: SendState, event: SendEvent) -> SendState:
    """The state of a served pull after an event."""
    return STATES.get((state, event), state)
