"""Things that are started, and given up by `close`, also at the end of a ``with``; SIGTERM.

Python 3.8 reads this file too: see `mocha_link.service.service_client`.
"""

from __future__ import annotations

import contextlib
import signal
from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import FrameType, TracebackType
from typing import TypeVar

_Closeable = TypeVar("_Closeable", bound="Closeable")  # Python 3.8 has no Self
_Startable = TypeVar("_Startable", bound="Startable")


class Closeable(ABC):
    """Use it as a context manager, or call `close`."""

    @abstractmethod
    def close(self) -> None:
        """Give up everything; may be called twice."""

    def __enter__(self: _Closeable) -> _Closeable:  # noqa: PYI019
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

    def __enter__(self: _Startable) -> _Startable:  # noqa: PYI019
        self.start()
        return self


class _Terminated(BaseException):
    """SIGTERM came."""


@contextlib.contextmanager
def until_terminated() -> Iterator[None]:
    """SIGTERM ends what is within the ``with``, and that is no error. For the main thread."""

    def terminate(_number: int, _frame: FrameType | None) -> None:
        raise _Terminated

    before = signal.signal(signal.SIGTERM, terminate)
    try:
        with contextlib.suppress(_Terminated):
            yield
    finally:
        signal.signal(signal.SIGTERM, before)
