"""Asks another program in JSON over ZeroMQ: one connection, an answer to each request, in time.

For any Python from 3.8 on that has `pyzmq`, as `service_client`, which is made of it.
"""

from __future__ import annotations

import json
import time
from abc import abstractmethod
from typing import Any, ClassVar

import zmq

from mocha_link.node.lifetime import Closeable
from mocha_link.service.endpoint_key import EndpointKeyError, connect, folder

_LOOK_S = 0.05
"""So often it is looked whether the program that is to answer has begun."""


class Asker(Closeable):
    """One who is asked, at an endpoint. One thread may use it; a context manager.

    Who does not answer may come back: every request tries anew.

    Args:
        endpoint: where to ask.
        timeout_s: how long to wait for an answer, beyond what a request itself wants to wait.

    Raises:
        Whatever `unreachable` makes: the endpoint is none.
    """

    whom: ClassVar[str]
    """Who answers, as in "is no node"."""
    option: ClassVar[str]
    """With which option that program answers."""

    def __init__(self, endpoint: str, *, timeout_s: float = 5.0) -> None:
        self.endpoint = endpoint
        self._timeout_s = timeout_s
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket: zmq.Socket[bytes] | None = None
        self._number = 0
        try:
            self._connected()
        except BaseException:
            self.close()
            raise

    @abstractmethod
    def refused(self, message: str, *, again: bool) -> Exception:
        """What is raised when a request is refused; `again`: it may be taken later."""

    @abstractmethod
    def unreachable(self, message: str) -> Exception:
        """What is raised when no node answers, or another program does."""

    def close(self) -> None:
        """Give up the connection; may be called twice."""
        self._hang_up()
        self._context.term()

    def ask(
        self, request: dict[str, Any], data: bytes | None = None, *, wait_s: float = 0.0
    ) -> tuple[dict[str, Any], list[bytes]]:
        """Send a request without what is None in it; returns its answer, and the data behind it."""
        self._number += 1
        asked = {key: value for key, value in request.items() if value is not None}
        asked["id"] = self._number
        frames = [json.dumps(asked).encode()] + ([] if data is None else [data])
        until_s = time.monotonic() + self._timeout_s + wait_s
        socket = self._connected()
        while socket is None and time.monotonic() < until_s:
            time.sleep(_LOOK_S)
            socket = self._connected()
        if socket is None:
            raise self.unreachable(
                f"no key of {self.endpoint} in {folder()}; is a {self.whom} running "
                f"there with {self.option} {self.endpoint}, started by you?"
            )
        try:
            socket.send_multipart(frames, zmq.NOBLOCK)
            while True:
                left_ms = int((until_s - time.monotonic()) * 1000)
                if left_ms <= 0 or not socket.poll(left_ms):
                    break
                answer, *parts = socket.recv_multipart()
                values = json.loads(answer)
                if values.get("id") not in (self._number, None):
                    continue  # to a request that we gave up
                if values["ok"]:
                    return values, parts
                raise self.refused(str(values["error"]), again=values.get("again") is True)
        except zmq.ZMQError:
            pass  # its queue is full: it has not been there for long
        except (ValueError, LookupError, AttributeError, TypeError, RecursionError):
            raise self.another() from None
        self._hang_up()
        raise self.unreachable(
            f"no answer from {self.endpoint} within {self._timeout_s:g} s; is a {self.whom} "
            f"running there with {self.option} {self.endpoint}?"
        )

    def another(self) -> Exception:
        """Another program answers: hang up, and raise this."""
        self._hang_up()
        return self.unreachable(f"what answers at {self.endpoint} is no {self.whom}")

    def _connected(self) -> zmq.Socket[bytes] | None:
        """The connection; None while the program that is to answer has left no key."""
        if self._socket is None:
            socket = self._context.socket(zmq.DEALER)
            socket.setsockopt(zmq.LINGER, 0)
            try:
                if not connect(socket, self.endpoint):
                    socket.close()
                    return None
            except EndpointKeyError as error:
                socket.close()
                raise self.unreachable(str(error)) from None
            except zmq.ZMQError as error:
                socket.close()
                raise self.unreachable(
                    f"'{self.endpoint}' is no endpoint ({zmq.strerror(error.errno or 0)}); write "
                    "tcp://127.0.0.1:port or ipc://path"
                ) from None
            self._socket = socket
        return self._socket

    def _hang_up(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None
