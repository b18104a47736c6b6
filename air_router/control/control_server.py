"""Serves a flight's requests, messages and links to this user's programs: JSON over ZeroMQ.

The socket is a ROUTER: REQ, DEALER and ROUTER sockets may connect, with or without REQ's empty
frame. Requests are untrusted: a request that is too large, malformed or unknown gets an error
reply, or closes its sender's connection. The flight reads requests at a limited rate, from all
clients in turn, so a flood takes none of its time.
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
from air_router.control.node_requests import NodeRequests
from mocha_link.errors import RequestError
from mocha_link.node import Node
from mocha_link.service import Listener, requests

PER_S: Final = 50.0
"""Most requests read per second."""

MAX_MESSAGE_BYTES: Final = 4 * 1024 * 1024
"""The largest data frame that a program may publish here; `mocha-link node` accepts larger ones."""

MOST_BYTES: Final = 8 * 1024 * 1024
"""Memory for all clients together: partial requests, and answers not read yet."""

MOST_BYTES_WITH_NODE: Final = 160 * 1024 * 1024
"""The same with published messages: two of the largest."""

TURN_S: Final = 0.002
"""Time reserved for the flight between two turns of serving clients."""

Execute = Callable[[CommandRequest, str], dict[str, Any]]


class ControlServer:
    """Answers requests of other programs.

    Args:
        endpoint: Where: ``ipc://path`` or ``tcp://127.0.0.1:24700``; port ``*`` takes a free one.
        execute: Carries a request out, and returns the answer.
        node: The UAV's node; its messages and links are served at the same endpoint. None: neither.
        monotonic: Real-time clock.
    """

    def __init__(
        self,
        endpoint: str,
        execute: Execute,
        node: Node | None = None,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self.endpoint = endpoint
        self._execute = execute
        self._node = node
        self._of_node: NodeRequests | None = None  # while it serves
        self._costly = Budget(COSTLY_PER_S, COSTLY_AT_ONCE, monotonic)  # of requests that plan
        self._listener: Listener | None = None  # while it serves

    def open(self) -> None:
        """Bind the endpoint; call it in the event loop that serves it.

        Raises:
            PortInUseError, ListenError: The endpoint is not available.
            RosError: The team has an invalid message definition.
        """
        with_node = self._node is not None
        self._listener = Listener(
            self.endpoint,
            "cannot take requests",
            max_bytes=2 * MAX_BYTES + (MAX_MESSAGE_BYTES if with_node else 0),
            most_bytes=MOST_BYTES_WITH_NODE if with_node else MOST_BYTES,
        )
        self.endpoint = self._listener.endpoint
        if self._node is not None:
            self._of_node = NodeRequests(self._node)

    async def run(self) -> None:
        """Answer until canceled."""
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
                    self._take(envelope, frames)
                    await asyncio.sleep(1 / PER_S)
                await asyncio.sleep(TURN_S)
        finally:
            loop.remove_reader(self._listener.fileno())

    def close(self) -> None:
        """Release the endpoint; may be called twice."""
        if self._of_node is not None:
            self._of_node.close()
            self._of_node = None
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def _take(self, envelope: list[bytes], frames: requests.Frames) -> None:
        """Answer a request, or pass it to the node's thread."""

        def send(answer: requests.Frames) -> None:
            if self._listener is not None:
                self._listener.send(envelope, answer)

        values: dict[str, Any] = {}
        try:
            values = requests.parse(frames, MAX_BYTES)
            verb = values.get("request")
            if self._of_node is not None and isinstance(verb, str) and verb in self._of_node.verbs:
                self._of_node.handle(frames, values.get("id"), send)
                return
            command = command_request_of(values)
            send(requests.reply(command.id, self._reply(command, frames)))
        except RequestError as error:
            send(requests.refusal(values.get("id"), str(error), again=error.again))

    def _reply(self, command: CommandRequest, frames: requests.Frames) -> requests.Response:
        """The reply to a request. Raises RequestError if it is not handled."""
        if len(frames) > 1:
            raise RequestError("a request is one frame")
        if not self._costly.affords(command):
            raise RequestError(TOO_MANY, again=True)
        return requests.Response(self._execute(command, "a program"))
