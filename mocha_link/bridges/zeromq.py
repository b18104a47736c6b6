"""The bridge to programs in any language that have ZeroMQ: requests, and a stream of messages.

It passes the requests of the node's service on, and adds JSON: whatever a program does to this
process does not touch the node.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import zmq

from mocha_link.bridges.values import ValueTranslator
from mocha_link.node.lifetime import Closeable
from mocha_link.service import requests
from mocha_link.service.endpoint import bind, connect
from mocha_link.service.requests import Frames, RequestError
from mocha_link.service.service_client import (
    ServiceClient,
    ServiceError,
    ServiceUnreachableError,
)
from mocha_link.store.payload import MAX_BYTES

MAX_REQUEST_BYTES = 8 * 1024 * 1024
PATIENCE_S = 5.0  # for the node's answer, beyond what a request wants to wait
MAX_WAIT_S = 60.0
MAX_PENDING = 1000
TICK_MS = 200
STREAM_WAIT_S = 1.0
PAUSE_S = 0.5

LOG = logging.getLogger("mocha_link")

Socket = zmq.Socket[bytes]


@dataclass(slots=True)
class _Pending:
    envelope: Frames  # of the program that asked
    id: object  # the program's own
    as_json: bool  # data are translated for it
    until_s: float  # monotonic; then it is refused


class ZeroMqBridge(Closeable):
    """Serves programs at an endpoint, and streams all messages at another.

    Port ``*`` takes a free one; `endpoint` and `stream` then say which. Use as a context manager.

    Args:
        node: endpoint of the node's service.
        endpoint: where programs ask; ``ipc://path`` or ``tcp://127.0.0.1:port``.
        stream: where they subscribe, if anywhere.
        as_json: the stream carries values and not data.

    Raises:
        ServiceUnreachableError: the node does not answer.
        PortInUseError: an endpoint is in use.
        ListenError: an endpoint is none.
    """

    def __init__(
        self, node: str, endpoint: str, *, stream: str | None = None, as_json: bool = False
    ) -> None:
        self._node = node
        self._as_json = as_json
        self._stopping = threading.Event()
        self._pending: dict[int, _Pending] = {}  # asked of the node, by number
        self._number = 0  # of the latest request
        self._stream: Socket | None = None
        self.stream: str | None = None
        with ServiceClient(node) as client:
            self._values = ValueTranslator(client.team())
        self._context: zmq.Context[Socket] = zmq.Context()
        try:
            # to programs
            self._front = requests.router(self._context, MAX_BYTES + MAX_REQUEST_BYTES)
            self.endpoint = bind(self._front, endpoint)
            if stream:
                self._stream = self._context.socket(zmq.PUB)
                self._stream.setsockopt(zmq.LINGER, 0)
                self.stream = bind(self._stream, stream)
        except Exception:
            self._context.destroy(0)
            raise
        self._back = self._dialled()  # to the node
        # requests, and the stream
        self._threads = [threading.Thread(target=self._serve, name="bridge requests", daemon=True)]
        if self._stream:
            work = threading.Thread(target=self._follow, name="bridge stream", daemon=True)
            self._threads.append(work)
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stop, and give up everything; may be called twice."""
        self._stopping.set()
        for thread in self._threads:
            thread.join()
        self._context.destroy(0)

    def _dialled(self) -> Socket:
        socket = self._context.socket(zmq.DEALER)
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.SNDHWM, MAX_PENDING)
        connect(socket, self._node)  # the node has answered, so it has left its key
        return socket

    def _serve(self) -> None:
        poller = zmq.Poller()
        poller.register(self._front, zmq.POLLIN)
        poller.register(self._back, zmq.POLLIN)
        while not self._stopping.is_set():
            ready = dict(poller.poll(TICK_MS))
            if self._front in ready:
                self._take(*requests.receive(self._front))
            if self._back in ready:
                self._answered(self._back.recv_multipart())
            self._give_up()

    def _take(self, envelope: Frames, frames: Frames) -> None:
        number: object = None
        if len(self._pending) >= MAX_PENDING:
            self._refuse(envelope, number, f"{MAX_PENDING} requests wait already")
            return
        try:
            asked = requests.parse(frames, MAX_REQUEST_BYTES)
            number = asked.get("id")
            values, data, as_json = self._values.request(asked, frames[1:])
            wait_s = values.get("wait_s")
            known = isinstance(wait_s, int | float) and 0 <= wait_s <= MAX_WAIT_S
            until_s = time.monotonic() + PATIENCE_S + (float(wait_s) if known else 0.0)  # type: ignore[arg-type]
            self._number += 1
            self._pending[self._number] = _Pending(envelope, number, as_json, until_s)
            header = json.dumps({**values, "id": self._number}).encode()
            self._back.send_multipart([header, *data], zmq.NOBLOCK)
        except RequestError as error:
            self._refuse(envelope, number, str(error), again=False)
        except zmq.Again:
            del self._pending[self._number]
            self._refuse(envelope, number, "the node does not answer")

    def _answered(self, frames: Frames) -> None:
        try:
            values: dict[str, Any] = json.loads(frames[0])
        except ValueError:
            LOG.warning("what answers at %s is no node", self._node)
            return
        pending = self._pending.pop(values.get("id"), None)  # type: ignore[arg-type]
        if pending is None:
            return  # no caller waits for it any more
        data: Sequence[bytes] = frames[1:]
        if pending.as_json:
            values, data = self._values.answer(values, data), ()
        values["id"] = pending.id
        requests.send(self._front, [*pending.envelope, json.dumps(values).encode(), *data])

    def _give_up(self) -> None:
        now_s = time.monotonic()
        for number in [n for n, one in self._pending.items() if now_s > one.until_s]:
            pending = self._pending.pop(number)
            self._refuse(pending.envelope, pending.id, "the node does not answer")

    def _refuse(self, envelope: Frames, number: object, why: str, *, again: bool = True) -> None:
        requests.send(self._front, [*envelope, *requests.refusal(number, why, again=again)])

    def _follow(self) -> None:
        """Stream what the node stores."""
        place: tuple[str, int] | None = None
        with ServiceClient(self._node, timeout_s=2.0) as client:
            while not self._stopping.is_set():
                try:
                    place, messages = client.since(place, wait_s=STREAM_WAIT_S, own=True)
                except (ServiceUnreachableError, ServiceError) as error:
                    LOG.warning("%s", error)
                    self._stopping.wait(PAUSE_S)
                    continue
                for about, data in messages:
                    self._publish(about, data)

    def _publish(self, about: dict[str, Any], data: bytes) -> None:
        if self._stream is None:
            return
        body = [data]
        if self._as_json:
            about, body = {**about, **self._values.value(about, data)}, []
        topic = f"/{about['robot']}/{about['topic'].lstrip('/')}"
        self._stream.send_multipart([topic.encode(), json.dumps(about).encode(), *body])
