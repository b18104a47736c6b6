"""Serves the requests of a flight to this user's programs on this machine: JSON over ZeroMQ.

One ROUTER: REQ, DEALER and ROUTER sockets may ask, with or without the empty frame that REQ sends.
What comes is believed in nothing: too large, broken or unknown, it costs an error reply. Requests
are read at a steady pace, in turn from all who ask, so that a flood of them takes no time of the
flight's.
"""

import argparse
import asyncio
import contextlib
import re
import time
from collections.abc import Callable
from typing import Any, Final
from urllib.parse import urlsplit

import zmq
import zmq.asyncio

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
from mocha_link.loopback import is_loopback
from mocha_link.service import requests
from mocha_link.service.endpoint import EndpointKeyError, bind, named, router, split

PER_S: Final = 50.0
"""So many requests are read in a second, and no more."""

_WAYS: Final = ("tcp", "ipc")
_NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,40}")

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
        self._context: zmq.asyncio.Context | None = None  # while it serves
        self._socket: zmq.asyncio.Socket | None = None  # a ROUTER, while it serves

    def open(self) -> None:
        """Take the endpoint.

        Raises:
            PortInUseError, ListenError: it cannot be had.
        """
        self._context = zmq.asyncio.Context()
        self._socket = router(self._context, 2 * MAX_BYTES)  # of more nothing is read
        try:
            self.endpoint = bind(self._socket, self.endpoint, "cannot take requests")
        except BaseException:
            self.close()
            raise

    async def run(self) -> None:
        """Answer until cancelled."""
        assert self._socket is not None  # noqa: S101 - it was opened
        while True:
            envelope, frames = split(await self._socket.recv_multipart())
            reply = self._reply(frames)
            with contextlib.suppress(zmq.ZMQError):  # it is gone, or does not read its answers
                await self._socket.send_multipart([*envelope, *reply], zmq.NOBLOCK)
            await asyncio.sleep(1 / PER_S)

    def close(self) -> None:
        """Give the endpoint up; may be called twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self._context is not None:
            self._context.term()
            self._context = None

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


def endpoint_of(text: str) -> str:
    """An endpoint from the command line: a name, a port of this machine, or either written out.

    A program that can talk to it flies the vehicle: only the same user's programs can.

    Raises:
        argparse.ArgumentTypeError: it is none, or others could reach it.
    """
    if text.isdecimal() or text == "*":
        text = f"tcp://127.0.0.1:{text}"
    elif _NAME.fullmatch(text):
        try:
            return named(text)
        except EndpointKeyError as error:
            raise argparse.ArgumentTypeError(str(error)) from None
    try:
        parts = urlsplit(text)
    except ValueError:
        parts = urlsplit("")
    if parts.scheme not in _WAYS:
        raise argparse.ArgumentTypeError(
            f"{text} is no endpoint; write a name, ipc://PATH, a port or tcp://127.0.0.1:PORT"
        )
    if parts.scheme == "tcp":
        host, _, port = text.removeprefix("tcp://").rpartition(":")
        if not is_loopback(host.strip("[]")):
            raise argparse.ArgumentTypeError(
                f"{text}: other machines could reach it and fly the vehicle; write "
                f"tcp://127.0.0.1:{port}, and reach it from elsewhere through SSH (ssh -L)"
            )
        text = f"tcp://127.0.0.1:{port}" if host == "localhost" else text
    return text
