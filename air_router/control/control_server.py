"""Serves the requests of a flight to this user's programs on this machine: JSON over ZeroMQ.

It is a ROUTER: REQ, DEALER and ROUTER sockets may ask, with or without the empty frame that REQ
sends. What comes is believed in nothing: too large, broken or unknown, it costs an error reply, or
its sender the connection. Requests are read at a steady pace, in turn from all who ask, so that a
flood of them takes no time of the flight's.
"""

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any, Final

from air_router.control.command_request import (
    COSTLY_AT_ONCE,
    COSTLY_PER_S,
    MAX_BYTES,
    TOO_MANY,
    Budget,
    CommandRequest,
    command_request_of,
)
from mocha_link.errors import RequestError
from mocha_link.service import Listener, requests

PER_S: Final = 50.0
"""So many requests are read in a second, and no more."""

MOST_BYTES: Final = 8 * 1024 * 1024
"""So much is kept for all clients together: requests that have come in part, answers not taken."""

TURN_S: Final = 0.002
"""So long the flight has for itself between two looks at the clients."""

Grant = Callable[[CommandRequest, str], dict[str, Any]]


class ControlServer:
    """Answers requests of other programs.

    Args:
        endpoint: Where: ``ipc://path`` or ``tcp://127.0.0.1:24700``; port ``*`` takes a free one.
        grant: Does what is asked for, and says what became of it.
        monotonic: Real time.
    """

    def __init__(
        self, endpoint: str, grant: Grant, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        self.endpoint = endpoint
        self._grant = grant
        self._costly = Budget(COSTLY_PER_S, COSTLY_AT_ONCE, monotonic)  # of requests that plan
        self._listener: Listener | None = None  # while it serves

    def open(self) -> None:
        """Take the endpoint.

        Raises:
            PortInUseError, ListenError: it cannot be had.
        """
        self._listener = Listener(
            self.endpoint, "cannot take requests", max_bytes=2 * MAX_BYTES, most_bytes=MOST_BYTES
        )
        self.endpoint = self._listener.endpoint

    async def run(self) -> None:
        """Answer until cancelled."""
        assert self._listener is not None  # noqa: S101 - it was opened
        loop, something = asyncio.get_running_loop(), asyncio.Event()
        loop.add_reader(self._listener.fileno(), something.set)
        try:
            while True:
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(self._listener.wait_ms / 1000):
                        await something.wait()
                something.clear()
                for envelope, frames in self._listener.requests():
                    self._listener.send(envelope, self._reply(frames))
                    await asyncio.sleep(1 / PER_S)
                await asyncio.sleep(TURN_S)
        finally:
            loop.remove_reader(self._listener.fileno())

    def close(self) -> None:
        """Give the endpoint up; may be called twice."""
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def _reply(self, frames: requests.Frames) -> requests.Frames:
        values: dict[str, Any] = {}
        try:
            values = requests.parse(frames, MAX_BYTES)
            command = command_request_of(values)
            return requests.reply(command.id, self._answer(command, frames))
        except RequestError as error:
            return requests.refusal(values.get("id"), str(error), again=error.again)

    def _answer(self, command: CommandRequest, frames: requests.Frames) -> requests.Answer:
        """What became of a request. Raises RequestError: it is not looked at."""
        if len(frames) > 1:
            raise RequestError("a request is one frame")
        if not self._costly.affords(command):
            raise RequestError(TOO_MANY, again=True)
        return requests.Answer(self._grant(command, "a program"))
