"""Where programs of one user on this machine meet: ZeroMQ endpoints that no other user reaches.

A web page that the operator has open, and every other user, reach all ports of 127.0.0.1, and
libzmq takes an HTTP POST for a message of ZMTP 1.0. So an ``ipc`` endpoint is a socket that only
its owner may open, and a TCP endpoint uses CURVE, whose key is in a file that only its owner may
read. A client that does not know the server's key cannot begin to talk. See docs/security.md.

For any Python from 3.8 on that has `pyzmq`, as `service_client`, which uses it.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import tempfile
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import zmq

from mocha_link.errors import MochaLinkError

TCP, IPC = "tcp://", "ipc://"
KEY_BYTES = 40  # of a CURVE key in Z85


class EndpointError(MochaLinkError):
    """An invalid endpoint."""


class EndpointKeyError(EndpointError):
    """The folder of the endpoints' keys, or a key in it, cannot be used."""


def folder() -> Path:
    """Where this user's endpoints are, and their keys; it is made if it is missing.

    Raises:
        EndpointKeyError: it cannot be made, or belongs to another user, or others may use it.
    """
    state = os.environ.get("XDG_STATE_HOME")  # not the runtime folder: services have none
    found = Path(state or Path.home() / ".local" / "state") / "mocha-link"
    try:
        found.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = found.lstat()
    except OSError as error:
        raise EndpointKeyError(
            f"{found}: cannot be made ({error.strerror}); set XDG_STATE_HOME to a folder of yours"
        ) from None
    if not stat.S_ISDIR(about.st_mode) or about.st_uid != os.getuid() or about.st_mode & 0o077:
        raise EndpointKeyError(
            f"{found}: is not a folder that only you may use; chmod 700 it, or remove it"
        )
    return found


def ipc_endpoint(name: str) -> str:
    """The ``ipc`` endpoint of a name, in this user's folder.

    Raises:
        EndpointKeyError: there can be no such folder.
    """
    return f"ipc://{folder() / name}"


def key_file(endpoint: str) -> Path:
    """Where the key of a TCP endpoint is: its public half, then its secret, a line each."""
    address = endpoint[len(TCP) :].replace("localhost:", "127.0.0.1:")
    return folder() / f"{address.replace('/', '_')}.key"


def load_key(endpoint: str) -> tuple[bytes, bytes] | None:
    """The public and the secret key of a TCP endpoint; None if no program has served there."""
    with contextlib.suppress(OSError, ValueError):
        public, secret = key_file(endpoint).read_bytes().split()
        if len(public) == len(secret) == KEY_BYTES:
            return public, secret
    return None


def save_key(endpoint: str, key: tuple[bytes, bytes]) -> None:
    """Write the key of a TCP endpoint down, for this user's programs.

    Raises:
        EndpointKeyError: it cannot be written.
    """
    path = key_file(endpoint)
    try:
        number, name = tempfile.mkstemp(dir=path.parent)  # with mode 0600
        with os.fdopen(number, "wb") as file:
            file.write(b"%b\n%b\n" % key)
        Path(name).replace(path)
    except OSError as error:
        raise EndpointKeyError(f"{path}: cannot be written ({error.strerror})") from None


def connect(client: zmq.Socket[Any], endpoint: str) -> bool:
    """Connect to an endpoint; False: it is TCP, and no program has left a key for it (yet).

    Raises:
        EndpointError: it is none, or there can be no key.
    """
    try:
        if endpoint.startswith(TCP):
            key = load_key(endpoint)
            if key is None:
                _check(endpoint)
                return False
            public, secret = zmq.curve_keypair()
            client.setsockopt(zmq.CURVE_SERVERKEY, key[0])
            client.setsockopt(zmq.CURVE_PUBLICKEY, public)
            client.setsockopt(zmq.CURVE_SECRETKEY, secret)
        if endpoint.startswith(f"{TCP}["):
            client.setsockopt(zmq.IPV6, 1)
        client.connect(endpoint)
    except zmq.ZMQError as error:
        raise EndpointError(
            f"'{endpoint}' is no endpoint ({zmq.strerror(error.errno or 0)}); write "
            "tcp://127.0.0.1:port or ipc://path"
        ) from None
    return True


def _check(endpoint: str) -> None:
    """Raises ZMQError for an invalid TCP endpoint."""
    with contextlib.suppress(ValueError):
        if urlsplit(endpoint).port is not None:
            return
    raise zmq.ZMQError(errno.EINVAL)
