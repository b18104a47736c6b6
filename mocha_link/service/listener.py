"""Serves an endpoint to the programs of one user on this machine, whatever they send.

The sockets are our own ZeroMQ (`mocha_link.node.router`): a client costs a connection of few that
there are, a request of so many bytes, and replies of so many that wait for it. What is more is
closed; a client may come again.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import socket
import stat
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import zmq
from zmq.utils import z85

from mocha_link.errors import ListenError, MissingExtraError, PortInUseError
from mocha_link.forks import closed_in_children
from mocha_link.loopback import is_loopback
from mocha_link.node import (
    ClientConnections,
    CurveServer,
    Mechanism,
    Null,
    Part,
    Poller,
    Router,
    kernel,
)
from mocha_link.service.endpoint import IPC, TCP, EndpointKeyError, load_key, save_key
from mocha_link.team import available

EXPIRE_S = 1.0
"""So often connections are closed that have shown no key in time, or have stopped."""

_BACKLOG = 16
_HOST = "127.0.0.1"


class Listener:
    """An endpoint: ``ipc://path`` or ``tcp://127.0.0.1:port``; ``*`` takes a free one.

    Only programs that may read this user's files reach it: the socket of an ``ipc`` endpoint has
    mode 0600, a TCP endpoint has a key. A path that another program has, and any other file there,
    stays as it is; files of a dead process are removed. One thread may use it.

    Args:
        what: What cannot be done if this cannot, as the beginning of a sentence.
        max_bytes: Of a request, all its parts together.
        kind: Of the socket, as ZeroMQ has it: ROUTER, or XPUB.
        burst: Requests of one client in a row.
        most_bytes: of queued replies for all clients together.

    Attributes:
        endpoint: Where it is.

    Raises:
        PortInUseError: another program serves there.
        ListenError: it is no endpoint, cannot be used, or other users or machines could reach it.
    """

    def __init__(  # noqa: PLR0913 - what it stands between
        self,
        endpoint: str,
        what: str,
        *,
        max_bytes: int,
        most_bytes: int,
        kind: bytes = b"ROUTER",
        burst: int = 1,
    ) -> None:
        self._path: Path | None = None  # of the socket, to be taken away
        self._folder: str | None = None  # around it, of ours
        listener, mechanism = self._bound(endpoint, f"{what} on {endpoint}", kind)
        self._poller = Poller()
        self._router = Router(
            listener, self._poller, ClientConnections(most_bytes), max_bytes, mechanism, burst=burst
        )
        self._router.watch("clients")
        self._expired_s = time.monotonic()

    def fileno(self) -> int:
        """Readable when something is to be done."""
        return self._poller.fileno()

    @property
    def wait_ms(self) -> int:
        """How long nothing is to be done if nothing comes; then call `requests` all the same."""
        return self._router.wait_ms

    def requests(self) -> Iterator[tuple[list[bytes], list[bytes]]]:
        """Those whose turn it is: the envelope of the reply, and the request's frames.

        Reply before you fetch the next.
        """
        now_s = time.monotonic()
        if now_s - self._expired_s > EXPIRE_S:
            self._expired_s = now_s
            self._router.expire(now_s)
        for name, parts in self._router.requests(self._poller.poll(0)):
            start = 1 if len(parts) > 1 and not parts[0] else 0
            envelope = [name, *map(bytes, parts[:start])]
            yield envelope, [bytes(each) for each in parts[start:]]

    def send(self, envelope: Sequence[bytes], frames: Sequence[Part]) -> None:
        """Send a reply; it is dropped if the client has closed."""
        self._router.reply(envelope[0], envelope[1:], frames)

    def publish(self, client: bytes, frames: Sequence[Part]) -> None:
        """Publish to a client without a request; its requests do not wait for that."""
        self._router.push(client, frames)
        self._router.flush(client)

    def stands(self, client: bytes) -> bool:
        """Whether a client, which its envelopes begin with, is still there."""
        return self._router.stands(client)

    def drop_stopped(self, after_s: float) -> None:
        """Close the connections of clients that take nothing of what waits for so long."""
        self._router.drop_stopped(time.monotonic(), after_s)

    def close(self) -> None:
        """Give the endpoint up; may be called twice."""
        self._router.close()
        self._poller.close()
        if self._path is not None:
            self._path.unlink(missing_ok=True)
            self._path = None
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None

    def _bound(
        self, endpoint: str, what: str, kind: bytes
    ) -> tuple[socket.socket, Callable[[], Mechanism]]:
        try:
            if endpoint.startswith(TCP):
                return self._bound_tcp(endpoint, what, kind)
            if endpoint.startswith(IPC):
                return self._bound_ipc(endpoint[len(IPC) :], what), partial(Null, kind)
            why = "it is no endpoint"
        except EndpointKeyError as error:
            raise ListenError(f"{what}: {error}") from None
        except (OSError, ValueError, OverflowError) as error:
            if getattr(error, "errno", None) == errno.EADDRINUSE:
                raise PortInUseError(f"{what}: it is in use; choose another one") from None
            why = getattr(error, "strerror", None) or str(error)
        raise ListenError(f"{what}: {why}; write ipc://path or tcp://127.0.0.1:port")

    def _bound_tcp(
        self, endpoint: str, what: str, kind: bytes
    ) -> tuple[socket.socket, Callable[[], Mechanism]]:
        host, _, number = endpoint[len(TCP) :].rpartition(":")
        if not host:
            raise ValueError("it has no port")
        if not is_loopback(host.strip("[]")):
            raise ListenError(
                f"{what}: other machines could reach it; write ipc://path or "
                f"tcp://127.0.0.1:{number}, and reach it from elsewhere through SSH"
            )
        if not available():
            raise MissingExtraError(f"{endpoint}, which encrypts,", "PyNaCl", "keys")
        key = load_key(endpoint) or zmq.curve_keypair()  # the last one: its clients find back
        host = _HOST if host == "localhost" else host
        listener = kernel.listener(host.strip("[]"), 0 if number == "*" else int(number))
        try:
            self.endpoint = f"{TCP}{host}:{listener.getsockname()[1]}"
            save_key(self.endpoint, key)
        except BaseException:
            listener.close()
            raise
        return listener, partial(CurveServer, bytes(z85.decode(key[1])), None, kind)

    def _bound_ipc(self, path: str, what: str) -> socket.socket:
        if path == "*":
            self._folder = tempfile.mkdtemp(prefix="mocha-link-")
            path = f"{self._folder}/socket"
        _clear(path, what)
        listener = closed_in_children(socket.socket(socket.AF_UNIX))
        before = os.umask(0o177)  # no other user may connect, not even at first
        try:
            listener.bind(path)
            listener.listen(_BACKLOG)
            listener.setblocking(False)
        except BaseException:
            listener.close()
            raise
        finally:
            os.umask(before)
        self._path, self.endpoint = Path(path), f"{IPC}{path}"
        return listener


def _clear(path: str, what: str) -> None:
    """Remove the files of a dead process.

    Raises ListenError, or OSError if another program listens there.
    """
    if path.startswith("@"):
        raise ListenError(f"{what}: every user could reach it; write ipc://path, without @")
    if not path:
        raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))
    try:
        is_socket = stat.S_ISSOCK(Path(path).lstat().st_mode)
    except FileNotFoundError:
        return
    if not is_socket:
        raise ListenError(f"{what}: there is a file of that name; choose another one")
    try:
        with socket.socket(socket.AF_UNIX) as other:
            other.settimeout(1.0)
            with contextlib.suppress(TimeoutError, BlockingIOError):  # it is there, and busy
                other.connect(path)
            raise OSError(errno.EADDRINUSE, "in use")
    except ConnectionRefusedError:
        Path(path).unlink(missing_ok=True)
