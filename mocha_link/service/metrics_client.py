"""Follows a node's link metrics and events from another process: JSON over ZeroMQ."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from typing import Any

import zmq

from mocha_link.errors import MochaLinkError
from mocha_link.node.lifetime import Closeable
from mocha_link.service.endpoint import EndpointError, connect
from mocha_link.service.service_client import LOOK_S

MAX_MESSAGE_BYTES = 64 * 1024 * 1024  # a snapshot of 255 links with all their topics is 8 MB


class MetricsError(MochaLinkError):
    """No metrics can be had from an endpoint."""


class Subscription(Closeable):
    """What a node's metrics endpoint sends, from a snapshot on. Use as a context manager.

    Raises MetricsError if the endpoint is none.
    """

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()  # of its socket
        self._socket = self._context.socket(zmq.SUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, MAX_MESSAGE_BYTES)
        self._socket.setsockopt(zmq.SUBSCRIBE, b"")
        try:
            self._connected = connect(self._socket, endpoint)
        except EndpointError as error:
            self._context.destroy(0)
            raise MetricsError(str(error)) from None

    def next(self, timeout_s: float) -> tuple[str, dict[str, Any]] | None:
        """("links", snapshot) or ("event", event); None if nothing comes for so long.

        Raises MetricsError if what comes is not a node's metrics.
        """
        until_s = time.monotonic() + timeout_s
        while not self._connected:
            if time.monotonic() > until_s:
                return None
            time.sleep(min(LOOK_S, timeout_s))
            self._connected = connect(self._socket, self._endpoint)
        if not self._socket.poll(max(0, int((until_s - time.monotonic()) * 1000))):
            return None
        frames = self._socket.recv_multipart()
        try:
            kind, fields = frames[0].decode(), json.loads(frames[1])
        except (ValueError, IndexError, RecursionError):
            raise self.strange() from None
        if not isinstance(fields, dict):
            raise self.strange()
        return kind, fields

    def strange(self) -> MetricsError:
        """The error for what is not a node's metrics."""
        return MetricsError(f"what {self._endpoint} sends is not a node's metrics")

    def close(self) -> None:
        """Give up the connection."""
        self._context.destroy(0)


def watch(endpoint: str, *, timeout_s: float = 5.0) -> Iterator[tuple[str, dict[str, Any]]]:
    """Follow a node's metrics: ("links", snapshot) first, then events and snapshots.

    Raises:
        MetricsError: nothing comes from the endpoint for `timeout_s` (real seconds), or what
            comes is not a node's metrics.
    """
    with Subscription(endpoint) as subscription:
        while news := subscription.next(timeout_s):
            yield news
        raise MetricsError(
            f"nothing from {endpoint} for {timeout_s:g} s; is a node running there with "
            f"--metrics {endpoint}?"
        )
