"""Binds ZeroMQ sockets for other programs on this machine."""

from __future__ import annotations

import contextlib
import errno
import socket
import stat
from pathlib import Path
from typing import Any

import zmq

from mocha_link.port import ListenError, PortInUseError

_IPC = "ipc://"


def bind(server: zmq.Socket[Any], endpoint: str, what: str = "cannot serve") -> str:
    """Bind, and say where: ``*`` in place of a port takes a free one.

    ZeroMQ would take the path of an ``ipc`` endpoint away from whoever has it, and delete any other
    file there; here that is an error. What a process that is gone has left is cleared away.

    Raises:
        PortInUseError: another program serves there.
        ListenError: it is no endpoint, or cannot be used.
    """
    what = f"{what} on {endpoint}"
    try:
        if endpoint.startswith(_IPC):
            _check_path(endpoint.removeprefix(_IPC), what)
        server.bind(endpoint)
    except (zmq.ZMQError, OSError) as error:
        if error.errno == errno.EADDRINUSE:
            raise PortInUseError(f"{what}: it is in use; choose another one") from None
        why = zmq.strerror(error.errno or 0)
        raise ListenError(f"{what}: {why}; write ipc://path or tcp://127.0.0.1:port") from None
    return server.getsockopt_string(zmq.LAST_ENDPOINT).rstrip("\0")


def _check_path(path: str, what: str) -> None:
    """Raises ListenError, or OSError if somebody listens there."""
    if path.startswith(("@", "*")):  # abstract, or a path that ZeroMQ chooses: nothing to lose
        return
    try:
        is_socket = stat.S_ISSOCK(Path(path).stat().st_mode)
    except OSError:
        return  # there is nothing, or ZeroMQ says what is wrong
    if not is_socket:
        raise ListenError(f"{what}: there is a file of that name; choose another one")
    with contextlib.suppress(ConnectionRefusedError), socket.socket(socket.AF_UNIX) as other:
        other.settimeout(1.0)
        with contextlib.suppress(TimeoutError, BlockingIOError):  # somebody is there, and busy
            other.connect(path)
        raise OSError(errno.EADDRINUSE, "in use")
