"""Where a node and its bridges serve other programs: no program loses its endpoint."""

import contextlib
import socket
import stat
import threading
from collections.abc import Iterator

import pytest
import zmq

from mocha_link.errors import ListenError, PortInUseError
from mocha_link.node import router
from mocha_link.node.zmtp import ZmtpSession
from mocha_link.service.endpoint import connect, key_file, load_key
from mocha_link.service.listener import Listener

WAIT_MS = 20_000
MOST = 100_000


def listen(endpoint: str, what: str = "cannot serve") -> Listener:
    return Listener(endpoint, what, max_bytes=MOST, most_bytes=4 * MOST)


class Echo:
    """Answers requests with themselves, on a thread of its own."""

    def __init__(self, endpoint: str) -> None:
        self.listener = listen(endpoint)
        self.endpoint = self.listener.endpoint
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stopping.is_set():
            for envelope, frames in self.listener.requests():
                self.listener.send(envelope, frames)
            self._stopping.wait(0.001)

    def close(self) -> None:
        self._stopping.set()
        self._thread.join()
        self.listener.close()


@pytest.fixture(params=["ipc", "tcp", "tcp over IPv6"])
def echo(request, tmp_path) -> Iterator[Echo]:
    endpoint = {"ipc": f"ipc://{tmp_path}/s", "tcp": "tcp://127.0.0.1:*"}.get(request.param)
    endpoint = endpoint or "tcp://[::1]:*"
    with contextlib.closing(Echo(endpoint)) as echo:
        yield echo


@contextlib.contextmanager
def client(endpoint: str, kind: int = zmq.DEALER) -> Iterator[zmq.Socket]:
    with zmq.Context() as context, context.socket(kind) as found:
        found.linger = 0
        assert connect(found, endpoint)
        yield found


def test_a_free_port_is_reported():
    with contextlib.closing(listen("tcp://127.0.0.1:*")) as listener:
        assert listener.endpoint.rpartition(":")[2].isdecimal()


@pytest.mark.parametrize("kind", [zmq.REQ, zmq.DEALER])
def test_what_is_requested_is_answered_whatever_its_size(echo, kind):
    with client(echo.endpoint, kind) as requester:
        for size in (0, 1, 300, 20_000, MOST - 1000):
            requester.send_multipart([b"?", bytes(size)])
            assert requester.poll(WAIT_MS)
            assert requester.recv_multipart() == [b"?", bytes(size)]


def test_what_another_program_has_stays_its_own(echo):
    with pytest.raises(PortInUseError, match="in use; choose another one"):
        listen(echo.endpoint)
    with client(echo.endpoint) as requester:
        requester.send(b"still there?")
        assert requester.poll(WAIT_MS)
        assert requester.recv_multipart() == [b"still there?"]


def test_what_a_process_that_is_gone_has_left_is_cleared_away(tmp_path):
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(f"{tmp_path}/s")
        left.listen()
    with contextlib.closing(listen(f"ipc://{tmp_path}/s")) as listener:
        assert listener.endpoint == f"ipc://{tmp_path}/s"
    assert not (tmp_path / "s").exists()


def test_a_file_is_not_deleted(tmp_path):
    path = tmp_path / "team.yaml"
    path.write_text("robots: {}")
    with pytest.raises(ListenError, match="there is a file of that name"):
        listen(f"ipc://{path}")
    assert path.read_text() == "robots: {}"


def test_a_link_is_a_file_of_that_name(tmp_path):
    """Another user may have put it there, to a socket of ours or of theirs."""
    (tmp_path / "s").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ListenError, match="there is a file of that name"):
        listen(f"ipc://{tmp_path}/s")
    assert (tmp_path / "s").is_symlink()


def test_only_messages_of_who_knows_the_key_are_received():
    with contextlib.closing(Echo("tcp://127.0.0.1:*")) as echo:
        endpoint = echo.endpoint
        path = key_file(endpoint)
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        with zmq.Context() as context, context.socket(zmq.DEALER) as intruder:
            intruder.linger = 0
            public, intruder.curve_secretkey = zmq.curve_keypair()
            intruder.curve_publickey = intruder.curve_serverkey = public
            with intruder.get_monitor_socket(zmq.EVENT_DISCONNECTED) as parted:
                intruder.connect(endpoint)
                intruder.send(b"open")
                assert parted.poll(WAIT_MS)
                intruder.disable_monitor()
            assert not intruder.poll(0)
        known = load_key(endpoint)
        assert load_key(endpoint.replace("127.0.0.1", "localhost")) == known
    with contextlib.closing(listen(endpoint)):
        assert load_key(endpoint) == known  # its clients find back


# --- what programs that do not know when to stop may cost


def raw(endpoint: str) -> socket.socket:
    """A connection that sends what a test wants."""
    kind, _, place = endpoint.partition("://")
    if kind == "ipc":
        found = socket.socket(socket.AF_UNIX)
        found.connect(place)
    else:
        host, _, number = place.replace("[", "").replace("]", "").rpartition(":")
        found = socket.create_connection((host, int(number)))
    found.settimeout(WAIT_MS / 1000)
    return found


def kept_bytes(echo: Echo) -> int:
    """What is kept for all clients."""
    return sum(each.holds_bytes for each in list(echo.listener._router._clients.routers))


def test_a_message_whose_parts_never_end_costs_its_sender_the_connection(tmp_path):
    """libzmq took 600 MB of such in five seconds: its limit is one of parts."""
    part = b"\1\xff" + bytes(255)
    with contextlib.closing(Echo(f"ipc://{tmp_path}/s")) as echo, raw(echo.endpoint) as hostile:
        hostile.sendall(ZmtpSession(1).hello)
        most = sent = 0
        with contextlib.suppress(ConnectionError):
            while sent < 8_000_000:
                sent += hostile.send(part * 100)
                most = max(most, kept_bytes(echo))
        assert sent < 8_000_000
        assert most < 2 * MOST
        with client(echo.endpoint) as requester:
            requester.send(b"?")
            assert requester.poll(WAIT_MS)


def test_parts_that_never_end_are_no_better_with_the_key():
    with contextlib.closing(Echo("tcp://127.0.0.1:*")) as echo, zmq.Context() as context:
        hostile = context.socket(zmq.DEALER)
        hostile.linger = 0
        hostile.sndhwm = 0
        with hostile, hostile.get_monitor_socket(zmq.EVENT_DISCONNECTED) as parted:
            connect(hostile, echo.endpoint)
            for _ in range(100):
                hostile.send(bytes(MOST // 50), zmq.SNDMORE)
            hostile.send(b"")
            assert parted.poll(WAIT_MS)
            hostile.disable_monitor()
        with client(echo.endpoint) as requester:
            requester.send(b"?")
            assert requester.poll(WAIT_MS)


@pytest.mark.parametrize("echo", ["ipc"], indirect=True)
def test_large_messages_that_come_in_part_are_bounded_together(echo):
    """Each as large as it may be: so many are not kept. On TCP they need the key first."""
    with contextlib.ExitStack() as stack:
        requester = stack.enter_context(client(echo.endpoint))
        hostiles = [stack.enter_context(raw(echo.endpoint)) for _ in range(20)]
        for hostile in hostiles:  # all are there before the first brings anything
            hostile.sendall(ZmtpSession(1).hello)
            assert hostile.recv(64)
        for hostile in hostiles:
            with contextlib.suppress(ConnectionError):
                hostile.sendall(b"\2" + MOST.to_bytes(8, "big") + bytes(MOST // 2))
        for _ in range(20):  # each answer after a turn of all connections
            requester.send(b"?")
            assert requester.poll(WAIT_MS)
            assert requester.recv() == b"?"
            assert kept_bytes(echo) <= 5 * MOST  # four, and one that comes


def greet(connection: socket.socket) -> None:
    """Bring the handshake of a connection without keys to its end."""
    session = ZmtpSession(MOST)
    connection.sendall(session.hello)
    while not session.ready:
        session.receive(connection.recv(1000))


@pytest.mark.parametrize("echo", ["ipc"], indirect=True)
def test_held_connections_keep_out_nobody_who_has_greeted(echo):
    """Of too many the oldest goes that has not: what the others have sent would be lost."""
    with contextlib.ExitStack() as stack:
        requester = stack.enter_context(raw(echo.endpoint))
        greet(requester)
        held = [stack.enter_context(raw(echo.endpoint)) for _ in range(3 * router.MAX_CONNECTIONS)]
        with contextlib.suppress(ConnectionError):
            while held[0].recv(1000):
                pass
        assert len(echo.listener._router._inside) <= router.MAX_CONNECTIONS
        requester.sendall(b"\0\1?")
        assert requester.recv(1000) == b"\0\1?"


@pytest.mark.parametrize("echo", ["ipc"], indirect=True)
def test_held_connections_that_have_greeted_keep_out_nobody(echo):
    """Of too many that have the one goes that has sent nothing for the longest time."""
    with contextlib.ExitStack() as stack:
        held = [stack.enter_context(raw(echo.endpoint)) for _ in range(router.MAX_CONNECTIONS)]
        for each in held:
            greet(each)
        with client(echo.endpoint) as requester:
            for number in range(3):
                requester.send(b"%d" % number)
                assert requester.poll(WAIT_MS)
                assert requester.recv() == b"%d" % number
        with contextlib.suppress(ConnectionError):
            while held[0].recv(1000):
                pass


def test_held_connections_keep_no_client_out(echo):
    with contextlib.ExitStack() as stack:
        requester = stack.enter_context(client(echo.endpoint))
        held = [stack.enter_context(raw(echo.endpoint)) for _ in range(3 * router.MAX_CONNECTIONS)]
        for number in range(3):
            requester.send(b"%d" % number)
            assert requester.poll(WAIT_MS)
            assert requester.recv() == b"%d" % number
        assert len(echo.listener._router._inside) <= router.MAX_CONNECTIONS
        with contextlib.suppress(ConnectionError):
            while held[0].recv(1000):
                pass


def test_who_shows_no_key_in_time_is_closed(monkeypatch):
    monkeypatch.setattr(router, "KEY_S", 0.05)
    monkeypatch.setattr("mocha_link.service.listener.EXPIRE_S", 0.01)
    with (
        contextlib.closing(Echo("tcp://127.0.0.1:*")) as echo,
        raw(echo.endpoint) as stranger,
        contextlib.suppress(ConnectionError),
    ):
        while stranger.recv(1000):
            pass


def test_a_socket_file_is_for_its_user_only(tmp_path):
    with contextlib.closing(listen(f"ipc://{tmp_path}/s")):
        assert stat.S_IMODE((tmp_path / "s").stat().st_mode) == 0o600


def test_a_folder_that_others_may_use_holds_no_keys(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (tmp_path / "mocha-link").mkdir(mode=0o755)
    with pytest.raises(ListenError, match="is not a folder that only you may use; chmod 700"):
        listen("tcp://127.0.0.1:*")


@pytest.mark.parametrize(
    ("endpoint", "why"),
    [
        ("tcp://0.0.0.0:5", "other machines could reach it; write ipc://path"),
        ("tcp://*:*", "other machines could reach it; write ipc://path"),
        ("ipc://@name", "every user could reach it; write ipc://path"),
    ],
)
def test_what_others_could_reach(endpoint, why):
    with pytest.raises(ListenError, match=why):
        listen(endpoint)


@pytest.mark.parametrize(
    "endpoint", ["nonsense", "tcp://127.0.0.1", "ipc:///no/such/place", "tcp://192.0.2.1:5"]
)
def test_what_cannot_be_served(endpoint):
    with pytest.raises(
        ListenError, match=f"cannot serve metrics on {endpoint}: .*; write ipc://path"
    ):
        listen(endpoint, "cannot serve metrics")
