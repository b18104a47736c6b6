"""Binds ZeroMQ sockets for other programs of the same user on this machine."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import stat
from pathlib import Path
from typing import Any

import zmq

from mocha_link.errors import ListenError, PortInUseError
from mocha_link.loopback import is_loopback
from mocha_link.service.endpoint_key import TCP, EndpointKeyError, keep_key, lock

_IPC = "ipc://"


def bind(server: zmq.Socket[Any], endpoint: str, what: str = "cannot serve") -> str:
    """Bind, and say where: ``*`` in place of a port takes a free one.

    Only programs that may read this user's files reach it: the socket of an ``ipc`` endpoint has
    mode 0600, a TCP endpoint has a key (`endpoint_key`). ZeroMQ would take the path of an ``ipc``
    endpoint away from the program that has it, and delete any other file there; here that is an
    error. What a process that is gone has left is cleared away.

    Raises:
        PortInUseError: another program serves there.
        ListenError: it is no endpoint, cannot be used, or other users or machines could reach it.
    """
    what = f"{what} on {endpoint}"
    try:
        if endpoint.startswith(TCP):
            return _bind_tcp(server, endpoint, what)
        if endpoint.startswith(_IPC):
            _check_path(endpoint[len(_IPC) :], what)
        # No other user may connect, not even at first; a folder of ZeroMQ's choice is entered.
        before = os.umask(0o077 if endpoint == f"{_IPC}*" else 0o177)
        try:
            server.bind(endpoint)
        finally:
            os.umask(before)
    except EndpointKeyError as error:
        raise ListenError(f"{what}: {error}") from None
    except (zmq.ZMQError, OSError) as error:
        if error.errno == errno.EADDRINUSE:
            raise PortInUseError(f"{what}: it is in use; choose another one") from None
        why = zmq.strerror(error.errno or 0)
        raise ListenError(f"{what}: {why}; write ipc://path or tcp://127.0.0.1:port") from None
    return _bound(server)


def _bind_tcp(server: zmq.Socket[Any], endpoint: str, what: str) -> str:
    host, _, port = endpoint[len(TCP) :].rpartition(":")
    if port and not is_loopback(host.strip("[]")):
        raise ListenError(
            f"{what}: other machines could reach it; write ipc://path or tcp://127.0.0.1:{port}, "
            "and reach it from elsewhere through SSH"
        )
    key = lock(server, endpoint)
    server.bind(endpoint)
    endpoint = _bound(server)
    keep_key(endpoint, key)
    return endpoint


def _bound(server: zmq.Socket[Any]) -> str:
    return server.getsockopt_string(zmq.LAST_ENDPOINT).rstrip("\0")


def _check_path(path: str, what: str) -> None:
    """Raises ListenError, or OSError if another program listens there."""
    if path.startswith("@"):
        raise ListenError(f"{what}: every user could reach it; write ipc://path, without @")
    if path.startswith("*"):  # a path that ZeroMQ chooses: nothing to lose
        return
    try:
        is_socket = stat.S_ISSOCK(Path(path).stat().st_mode)
    except OSError:
        return  # there is nothing, or ZeroMQ says what is wrong
    if not is_socket:
        raise ListenError(f"{what}: there is a file of that name; choose another one")
    with contextlib.suppress(ConnectionRefusedError), socket.socket(socket.AF_UNIX) as other:
        other.settimeout(1.0)
        with contextlib.suppress(TimeoutError, BlockingIOError):  # it is there, and busy
            other.connect(path)
        raise OSError(errno.EADDRINUSE, "in use")
