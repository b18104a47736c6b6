"""Whose turn it is: the exchanges that wait for the channel, in order.

They are kept by the robot that requests. So of five hundred robots of which most receive a
transmission, only the few that receive none are looked through, not their hundred thousand
exchanges.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import defaultdict
from collections.abc import Set as AbstractSet
from operator import itemgetter

from sitl.experiment.engine.exchange import Exchange, Turn


class Turns:
    """Gives exchanges their `turn`, and takes it back; nothing else sets it."""

    def __init__(self) -> None:
        self._by_requesting: defaultdict[int, list[tuple[Turn, Exchange]]] = defaultdict(list)

    def __bool__(self) -> bool:
        """Whether any waits."""
        return bool(self._by_requesting)

    def add(self, exchange: Exchange, turn: Turn) -> None:
        """It waits from now on."""
        exchange.turn = turn
        insort(self._by_requesting[exchange.link.requesting], (turn, exchange))

    def remove(self, exchange: Exchange) -> None:
        """It does not wait any more, if it did."""
        requesting = exchange.link.requesting
        if exchange.turn is None:
            return
        own = self._by_requesting[requesting]
        del own[bisect_left(own, exchange.turn, key=itemgetter(0))]
        exchange.turn = None
        if not own:
            del self._by_requesting[requesting]

    def first_beside(self, occupied: AbstractSet[int]) -> Exchange | None:
        """The first of those neither of whose robots is occupied; None: there is none."""
        first: tuple[Turn, Exchange] | None = None
        for requesting in self._by_requesting.keys() - occupied:
            for waiting in self._by_requesting[requesting]:
                if first is not None and waiting > first:
                    break
                if waiting[1].link.answering not in occupied:
                    first = waiting
                    break
        return None if first is None else first[1]
