"""What is counted while a run goes on: transmissions, contacts, pulls."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from sitl.experiment.engine.exchange import Exchange
from sitl.experiment.engine.result import CONTACT, TRANSMISSION

Row = tuple[float, float, float, int, int, int, int, int, bool]
"""A transmission, in the order of `result.TRANSMISSION`."""

ContactRow = tuple[float, float, int, int]
"""A contact, in the order of `result.CONTACT`."""

_Table = np.ndarray[tuple[int], np.dtype[np.void]]


class AirtimeStats:
    """Notes transmissions, contacts and pulls.

    Args:
        told: Takes every transmission as it ends, for the event log.

    Attributes:
        complete: Pulls that came to their end.
        broken: Pulls that were given up when contact was lost.
    """

    def __init__(self, told: Callable[[Row], None]) -> None:
        self.complete = self.broken = 0
        self._told = told
        self._rows: list[Row] = []  # in the order of their ends
        self._contacts: list[ContactRow] = []  # that are over

    def sent(self, exchange: Exchange, end_s: float, part: float | None = None) -> None:
        """A transmission of an exchange ends; `part`: it was cut, and so much of it had crossed."""
        load, start_s, ready_s = exchange.load, exchange.start_s, exchange.ready_s
        if load is None or start_s is None or ready_s is None:
            raise AssertionError("a transmission begins before it ends")
        row = (
            round(ready_s, 6),
            round(start_s, 6),
            round(end_s, 6),
            *exchange.link,
            int(load.stage),
            load.messages if part is None else 0,
            load.size if part is None else int(load.size * part),
            part is None,
        )
        self._rows.append(row)
        self._told(row)

    def parted(self, contact: ContactRow) -> None:
        """A contact is over."""
        self._contacts.append(contact)

    def pulled(self, *, broken: bool) -> None:
        """A pull is over."""
        if broken:
            self.broken += 1
        else:
            self.complete += 1

    def transmissions(self) -> _Table:
        """All transmissions so far, as `result.TRANSMISSION`."""
        return np.array(self._rows, dtype=TRANSMISSION)

    def contacts(self, lasting: Iterable[ContactRow]) -> _Table:
        """All contacts so far, and those that last, as `result.CONTACT`."""
        return np.array(sorted((*self._contacts, *lasting)), dtype=CONTACT)
