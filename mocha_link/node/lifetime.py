"""Things that are started, and given up by `close`, also at the end of a ``with``.

Python 3.8 reads this file too: see `mocha_link.service.service_client`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self


class Closeable(ABC):
    """Use it as a context manager, or call `close`."""

    @abstractmethod
    def close(self) -> None:
        """Give up everything; may be called twice."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class Startable(Closeable):
    """Use it as a context manager, or call `start` and `close`."""

    @abstractmethod
    def start(self) -> None:
        """Begin."""

    def __enter__(self) -> Self:
        self.start()
        return self
