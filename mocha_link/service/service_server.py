"""Serves a node's messages to programs on the same machine: the socket around `service`.

One ROUTER. REQ, DEALER and ROUTER sockets may ask, with or without the empty frame that REQ sends.
A program that reaches the endpoint may publish in the robot's name: keep it on this machine.
"""

from __future__ import annotations

import contextlib
import logging
import math
import time
from functools import partial

import zmq

from mocha_link.links.metrics import LinkEvent, MessageStored
from mocha_link.node.node import Node
from mocha_link.service.endpoint_server import EndpointServer
from mocha_link.service.service import MAX_HEADER_BYTES, Service
from mocha_link.store.payload import MAX_BYTES

MAX_UNREAD = 16  # answers that a client may leave unread before more of them are dropped
MAX_FRAMES = 8

LOG = logging.getLogger("mocha_link")


class ServiceServer(EndpointServer):
    """Serves a started node at an endpoint: ``ipc://path`` or ``tcp://127.0.0.1:port``.

    Raises:
        RosError: the team brings along a definition that cannot be used.
    """

    def __init__(self, node: Node, endpoint: str) -> None:
        super().__init__(node, endpoint, "the node")
        self._service = Service(node)

    def _socket(self, context: zmq.Context[zmq.Socket[bytes]]) -> zmq.Socket[bytes]:
        router = context.socket(zmq.ROUTER)
        router.setsockopt(zmq.SNDHWM, MAX_UNREAD)
        router.setsockopt(zmq.RCVHWM, MAX_UNREAD)
        router.setsockopt(zmq.MAXMSGSIZE, MAX_BYTES + MAX_HEADER_BYTES)
        return router

    def _note(self, event: LinkEvent) -> None:
        if isinstance(event, MessageStored):
            self._wake()

    def _wait_ms(self) -> int | None:
        until_s = self._service.until_s
        if until_s is None:
            return None
        return math.ceil(max(0.0, until_s - time.monotonic()) * 1000)

    def _turn(self, server: zmq.Socket[bytes], *, ready: bool) -> None:
        if ready:
            self._take(server, server.recv_multipart())
        self._service.tick(time.monotonic())

    def _end(self) -> None:
        self._service.tick(time.monotonic(), ending=True)

    def _take(self, router: zmq.Socket[bytes], frames: list[bytes]) -> None:
        delimiter = 2 if len(frames) > 1 and not frames[1] else 1
        envelope, body = frames[:delimiter], frames[delimiter : delimiter + MAX_FRAMES]
        self._service.request(body, partial(_send, router, envelope), time.monotonic())


def _send(router: zmq.Socket[bytes], envelope: list[bytes], answer: list[bytes]) -> None:
    with contextlib.suppress(zmq.Again):  # it does not read what it asks for
        router.send_multipart([*envelope, *answer], zmq.NOBLOCK)
