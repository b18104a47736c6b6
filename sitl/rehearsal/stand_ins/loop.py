"""An asyncio event loop whose clock is simulated time: nothing sleeps."""

from __future__ import annotations

import asyncio
import math
import selectors
from collections.abc import Callable
from typing import Any, Final, Protocol

_SOON_S: Final = 1e-9


class World(Protocol):
    """Whatever goes on while the loop waits."""

    @property
    def now_s(self) -> float:
        """Simulated seconds."""

    def advance(self, until_s: float) -> list[Callable[[], object]]:
        """Let time pass until then, or until there is something for the loop: what it is to call.

        Raises:
            BaseException: the loop is to end, in whatever state it is.
        """


class SimulatedLoop(asyncio.SelectorEventLoop):
    """Where another loop would wait for sockets, this one lets the world go on.

    Signals and keyboards are left alone; what would run in another thread runs at once.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        super().__init__(_Waiting(self))
        self._clock_resolution = _SOON_S  # asyncio's own: a timer is due so much early

    def time(self) -> float:
        """Simulated seconds."""
        return self.world.now_s

    def call_soon_threadsafe(  # type: ignore[override]
        self, callback: Callable[..., object], *args: Any, context: Any = None
    ) -> asyncio.Handle:
        """There is one thread."""
        return self.call_soon(callback, *args, context=context)

    def run_in_executor(self, *args: Any, **_: Any) -> Any:  # type: ignore[override]
        """Run it now; only the result comes later."""
        _executor, function, *arguments = args
        future = self.create_future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:  # noqa: BLE001 - as an executor hands it on
            future.set_exception(error)
        return future

    def add_signal_handler(self, *_: Any, **__: Any) -> None:  # type: ignore[override]
        """Simulated programs get no signals."""

    def remove_signal_handler(self, *_: Any, **__: Any) -> bool:
        """There is none."""
        return False

    def add_reader(self, *_: Any, **__: Any) -> None:  # type: ignore[override]
        """Nor a keyboard."""

    def remove_reader(self, *_: Any, **__: Any) -> bool:
        """There is none."""
        return False


class _Waiting(selectors.SelectSelector):
    """Selects nothing ever; waiting is what the world goes on in."""

    def __init__(self, loop: SimulatedLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[Any]:
        """Let so much time pass, or less if something comes."""
        if timeout is None or timeout > 0.0:
            world = self._loop.world
            until_s = math.inf if timeout is None else world.now_s + timeout + _SOON_S
            for callback in world.advance(until_s):
                self._loop.call_soon(callback)
        return []
