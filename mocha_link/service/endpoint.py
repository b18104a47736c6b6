"""Where programs of one user on this machine meet: ZeroMQ endpoints that no other user reaches.

A web page that the operator has open, and every other user, reach all ports of 127.0.0.1, and
libzmq takes an HTTP POST for a message of ZMTP 1.0. So an ``ipc`` endpoint is a socket that only
its owner may open, and a TCP endpoint speaks CURVE, whose key is in a file that only its owner may
read. A client that does not know the server's key cannot begin to talk. docs/security.md says more.

For any Python from 3.8 on that has `pyzmq`, as `service_client`, which uses it.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import stat
import tempfile
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

import zmq

from mocha_link.errors import ListenError, MochaLinkError, PortInUseError
from mocha_link.loopback import is_loopback

TCP, IPC = "tcp://", "ipc://"
KEY_BYTES = 40  # of a CURVE key in Z85
_HANDSHAKE_MS = 3000
MAX_UNREAD = 16  # answers that a client may leave unread before more of them are dropped

AnySocket = TypeVar("AnySocket", bound="zmq.Socket[Any]")


class EndpointError(MochaLinkError):
    """What was named as an endpoint is none."""


class EndpointKeyError(EndpointError):
    """The folder of the endpoints' keys, or a key in it, cannot be used."""


def router(context: zmq.Context[AnySocket], max_bytes: int) -> AnySocket:
    """A socket that answers, to be bound: no client fills the memory with unread answers."""
    server = context.socket(zmq.ROUTER)
    server.setsockopt(zmq.LINGER, 0)
    server.setsockopt(zmq.SNDHWM, MAX_UNREAD)
    server.setsockopt(zmq.RCVHWM, MAX_UNREAD)
    server.setsockopt(zmq.MAXMSGSIZE, max_bytes)
    return server


def split(frames: list[bytes]) -> tuple[list[bytes], list[bytes]]:
    """Of what a router received: the envelope that the answer needs, and the request's frames."""
    start = 2 if len(frames) > 1 and not frames[1] else 1
    return frames[:start], frames[start:]


def send_answer(server: zmq.Socket[bytes], frames: list[bytes]) -> None:
    """Send an answer, its envelope first, if the client takes it."""
    with contextlib.suppress(zmq.Again):  # it does not read what it asks for
        server.send_multipart(frames, zmq.NOBLOCK)


def bind(server: zmq.Socket[Any], endpoint: str, what: str = "cannot serve") -> str:
    """Bind, and say where: ``*`` in place of a port takes a free one.

    Only programs that may read this user's files reach it: the socket of an ``ipc`` endpoint has
    mode 0600, a TCP endpoint has a key. ZeroMQ would take the path of an ``ipc`` endpoint away
    from the program that has it, and delete any other file there; here that is an error. What a
    process that is gone has left is cleared away.

    Raises:
        PortInUseError: another program serves there.
        ListenError: it is no endpoint, cannot be used, or other users or machines could reach it.
    """
    what = f"{what} on {endpoint}"
    try:
        if endpoint.startswith(TCP):
            return _bind_tcp(server, endpoint, what)
        if endpoint.startswith(IPC):
            _check_path(endpoint[len(IPC) :], what)
        # No other user may connect, not even at first; a folder of ZeroMQ's choice is entered.
        before = os.umask(0o077 if endpoint == f"{IPC}*" else 0o177)
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
    if not zmq.has("curve"):
        raise EndpointKeyError("the ZeroMQ library here has no CURVE; serve at ipc://path")
    key = kept_key(endpoint) or zmq.curve_keypair()  # the last one, so that its clients find back
    server.setsockopt(zmq.CURVE_SERVER, 1)
    server.setsockopt(zmq.CURVE_SECRETKEY, key[1])
    server.setsockopt(zmq.HANDSHAKE_IVL, _HANDSHAKE_MS)
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


def named(name: str) -> str:
    """The ``ipc`` endpoint of a name, in this user's folder.

    Raises:
        EndpointKeyError: there can be no such folder.
    """
    return f"ipc://{folder() / name}"


def key_file(endpoint: str) -> Path:
    """Where the key of a TCP endpoint is: its public half, then its secret, a line each."""
    address = endpoint[len(TCP) :].replace("localhost:", "127.0.0.1:")
    return folder() / f"{address.replace('/', '_')}.key"


def kept_key(endpoint: str) -> tuple[bytes, bytes] | None:
    """The public and the secret key of a TCP endpoint; None if no program has served there."""
    with contextlib.suppress(OSError, ValueError):
        public, secret = key_file(endpoint).read_bytes().split()
        if len(public) == len(secret) == KEY_BYTES:
            return public, secret
    return None


def keep_key(endpoint: str, key: tuple[bytes, bytes]) -> None:
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
            key = kept_key(endpoint)
            if key is None:
                _check(endpoint)
                return False
            public, secret = zmq.curve_keypair()
            client.setsockopt(zmq.CURVE_SERVERKEY, key[0])
            client.setsockopt(zmq.CURVE_PUBLICKEY, public)
            client.setsockopt(zmq.CURVE_SECRETKEY, secret)
        client.connect(endpoint)
    except zmq.ZMQError as error:
        raise EndpointError(
            f"'{endpoint}' is no endpoint ({zmq.strerror(error.errno or 0)}); write "
            "tcp://127.0.0.1:port or ipc://path"
        ) from None
    return True


def _check(endpoint: str) -> None:
    """Raises ZMQError for what is no TCP endpoint."""
    with contextlib.suppress(ValueError):
        if urlsplit(endpoint).port is not None:
            return
    raise zmq.ZMQError(errno.EINVAL)
