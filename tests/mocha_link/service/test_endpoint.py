"""Where a node and its bridges serve other programs: no program loses its endpoint."""

import socket
import stat

import pytest
import zmq

from mocha_link.errors import ListenError, PortInUseError
from mocha_link.service.endpoint import bind, connect, kept_key, key_file


@pytest.fixture
def server():
    with zmq.Context() as context, context.socket(zmq.ROUTER) as found:
        yield found


@pytest.fixture
def other():
    with zmq.Context() as context, context.socket(zmq.ROUTER) as found:
        yield found


def test_a_free_port_is_told(server):
    assert bind(server, "tcp://127.0.0.1:*").rpartition(":")[2].isdecimal()


@pytest.mark.parametrize("kind", ["ipc", "tcp"])
def test_what_another_program_has_stays_its_own(server, other, tmp_path, kind):
    endpoint = bind(other, f"ipc://{tmp_path}/s" if kind == "ipc" else "tcp://127.0.0.1:*")
    with pytest.raises(PortInUseError, match="in use; choose another one"):
        bind(server, endpoint)
    with zmq.Context() as context, context.socket(zmq.DEALER) as client:
        client.linger = 0
        assert connect(client, endpoint)
        client.send(b"still there?")
        assert other.poll(10_000)
        assert other.recv_multipart()[1] == b"still there?"


def test_what_a_process_that_is_gone_has_left_is_cleared_away(server, tmp_path):
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(f"{tmp_path}/s")
        left.listen()
    assert bind(server, f"ipc://{tmp_path}/s") == f"ipc://{tmp_path}/s"


def test_a_file_is_not_deleted(server, tmp_path):
    path = tmp_path / "team.yaml"
    path.write_text("robots: {}")
    with pytest.raises(ListenError, match="there is a file of that name"):
        bind(server, f"ipc://{path}")
    assert path.read_text() == "robots: {}"


def bound(socket, endpoint):
    try:
        bind(socket, endpoint)
    except PortInUseError:
        return False
    return True


def test_only_who_knows_the_key_is_heard(server, other):
    endpoint = bind(server, "tcp://127.0.0.1:*")
    path = key_file(endpoint)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    with zmq.Context() as context, context.socket(zmq.DEALER) as intruder:
        intruder.linger = 0
        public, intruder.curve_secretkey = zmq.curve_keypair()
        intruder.curve_publickey = intruder.curve_serverkey = public
        with intruder.get_monitor_socket(zmq.EVENT_DISCONNECTED) as parted:
            intruder.connect(endpoint)
            intruder.send(b"open")
            assert parted.poll(20_000)
            intruder.disable_monitor()
    assert not server.poll(0)
    assert kept_key(endpoint.replace("127.0.0.1", "localhost")) == kept_key(endpoint)
    server.close()
    known = kept_key(endpoint)
    while not bound(other, endpoint):
        pass  # ZeroMQ gives the port back when its own thread comes to it
    assert kept_key(endpoint) == known  # its clients find back


def test_a_socket_file_is_for_its_user_only(server, tmp_path):
    bind(server, f"ipc://{tmp_path}/s")
    assert stat.S_IMODE((tmp_path / "s").stat().st_mode) == 0o600


def test_a_folder_that_others_may_use_holds_no_keys(server, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (tmp_path / "mocha-link").mkdir(mode=0o755)
    with pytest.raises(ListenError, match="is not a folder that only you may use; chmod 700"):
        bind(server, "tcp://127.0.0.1:*")


@pytest.mark.parametrize(
    ("endpoint", "why"),
    [
        ("tcp://0.0.0.0:5", "other machines could reach it; write ipc://path"),
        ("tcp://*:*", "other machines could reach it; write ipc://path"),
        ("ipc://@name", "every user could reach it; write ipc://path"),
    ],
)
def test_what_others_could_reach(server, endpoint, why):
    with pytest.raises(ListenError, match=why):
        bind(server, endpoint)


@pytest.mark.parametrize(
    "endpoint", ["nonsense", "tcp://127.0.0.1", "ipc:///no/such/place", "tcp://192.0.2.1:5"]
)
def test_what_cannot_be_served(server, endpoint):
    with pytest.raises(ListenError, match=f"cannot serve news on {endpoint}: .*; write ipc://path"):
        bind(server, endpoint, "cannot serve news")
