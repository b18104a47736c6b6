import contextlib
import resource
import select
import socket
import threading

import pytest

from sitl.team.relay import Relay, RelayedPair, RelayError

WAIT_S = 60.0
SILENCE_S = 0.3  # how long nothing may come while a link is cut


class Server:
    """Listens like a node; hands out what was accepted."""

    def __init__(self, host: str = "127.0.0.1") -> None:
        self.socket = socket.create_server((host, 0))
        self.socket.settimeout(WAIT_S)

    @property
    def endpoint(self) -> tuple[str, int]:
        return self.socket.getsockname()

    def accept(self) -> socket.socket:
        accepted, _ = self.socket.accept()
        accepted.settimeout(WAIT_S)
        return accepted


@pytest.fixture
def server():
    server = Server()
    yield server
    server.socket.close()


@contextlib.contextmanager
def relayed(server, **options):
    host, port = "127.0.1.1", server.endpoint[1]
    pair = RelayedPair("io", "titan", (host, port), server.endpoint)
    with Relay([pair], **options) as relay:
        yield relay, (host, port)


def dial(endpoint) -> socket.socket:
    connection = socket.create_connection(endpoint, timeout=WAIT_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


@contextlib.contextmanager
def connected(server, **options):
    """A connection over a link that is up."""
    with relayed(server, **options) as (relay, endpoint):
        relay.set_link("io", "titan", up=True)
        with dial(endpoint) as client, server.accept() as node:
            yield relay, client, node


def receive(connection: socket.socket, size: int) -> bytes:
    received = b""
    while len(received) < size:
        part = connection.recv(size - len(received))
        if not part:
            break
        received += part
    return received


def waiting(connection: socket.socket) -> bool:
    return bool(select.select([connection], [], [], 0)[0])


def silent(connection: socket.socket) -> bool:
    connection.settimeout(SILENCE_S)
    try:
        return connection.recv(1, socket.MSG_PEEK) == b"never"
    except TimeoutError:
        return True
    finally:
        connection.settimeout(WAIT_S)


def test_the_end_of_one_side_reaches_the_other_after_all_bytes(server):
    with connected(server) as (_, client, node):
        client.sendall(b"x" * 500_000)
        client.shutdown(socket.SHUT_WR)
        assert len(receive(node, 600_000)) == 500_000
        node.sendall(b"answer")  # half-open: the other direction still works
        node.close()
        assert receive(client, 100) == b"answer"


def test_a_cut_in_mid_transfer_stalls_at_once_and_goes_on_when_healed(server):
    payload = bytes(range(256)) * 40_000  # 10 MB: far more than the kernel's buffers
    with connected(server, close_after_s=WAIT_S * 2) as (relay, client, node):
        sender = threading.Thread(target=client.sendall, args=(payload,))
        sender.start()
        got = receive(node, 1_000_000)
        relay.set_link("io", "titan", up=False)
        while not silent(node):  # what the kernel had taken before the cut
            got += node.recv(1 << 20)
        assert len(got) < len(payload)
        node.sendall(b"credit")
        assert silent(client)
        relay.set_link("io", "titan", up=True)
        got += receive(node, len(payload) - len(got))
        assert got == payload
        assert receive(client, 6) == b"credit"
        sender.join(WAIT_S)


def test_links_are_cut_and_healed_while_no_descriptor_is_left(server):
    """A process with many robots reaches its limit; connections wait until there are others."""
    most, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with relayed(server) as (relay, endpoint), socket.socket() as client:
        client.setblocking(False)
        resource.setrlimit(resource.RLIMIT_NOFILE, (client.fileno(), hard))
        try:
            client.connect_ex(endpoint)
            assert select.select([], [client], [], WAIT_S)[1]  # it waits to be accepted
            healing = threading.Thread(
                target=relay.set_link, args=("io", "titan"), kwargs={"up": True}, daemon=True
            )
            healing.start()
            healing.join(WAIT_S / 4)
            assert not healing.is_alive()
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
        with server.accept() as node:
            client.setblocking(True)
            client.sendall(b"ping")
            assert receive(node, 4) == b"ping"


def test_a_lasting_cut_closes_the_connections(server):
    with connected(server, close_after_s=0.05) as (relay, client, node):
        client.sendall(b"ping")
        assert receive(node, 4) == b"ping"
        relay.set_link("io", "titan", up=False)
        for end in (client, node):
            with pytest.raises(ConnectionResetError):
                end.recv(1)


def test_nothing_reaches_the_node_while_the_link_is_down(server):
    with relayed(server, close_after_s=0.05) as (_, endpoint):
        with pytest.raises(ConnectionResetError), dial(endpoint) as client:
            receive(client, 1)
        server.socket.settimeout(SILENCE_S)
        with pytest.raises(TimeoutError):
            server.accept()


def test_new_connections_work_at_once_when_the_link_is_back(server):
    with relayed(server) as (relay, endpoint), dial(endpoint) as early:
        early.sendall(b"early")
        relay.set_link("io", "titan", up=True)
        with dial(endpoint) as late:
            late.sendall(b"later")
            received = set()
            for _ in range(2):
                with server.accept() as node:
                    received.add(receive(node, 5))
            assert received == {b"early", b"later"}


def test_a_node_that_does_not_listen_is_a_refused_connection():
    with socket.create_server(("127.0.0.1", 0)) as other:
        free = other.getsockname()
    pair = RelayedPair("io", "titan", ("127.0.1.1", free[1]), free)
    with Relay([pair]) as relay:
        relay.set_link("io", "titan", up=True)
        with pytest.raises(ConnectionResetError), dial(pair.dialled) as client:
            client.recv(1)


def test_a_cut_separates_one_pair_only(server):
    other = Server("127.0.0.2")
    pairs = [
        RelayedPair("io", "titan", ("127.0.1.1", server.endpoint[1]), server.endpoint),
        RelayedPair("io", "europa", ("127.0.1.2", other.endpoint[1]), other.endpoint),
    ]
    with contextlib.closing(other.socket), Relay(pairs) as relay:
        for peer in ("titan", "europa"):
            relay.set_link("io", peer, up=True)
        with (
            dial(pairs[0].dialled) as to_titan,
            server.accept() as titan,
            dial(pairs[1].dialled) as to_europa,
            other.accept() as europa,
        ):
            relay.set_link("titan", "io", up=False)
            to_titan.sendall(b"lost")
            to_europa.sendall(b"received")
            assert receive(europa, 8) == b"received"
            assert silent(titan)


def test_a_limited_link_carries_no_more_than_its_rate(server):
    now_s = [0.0]
    with connected(server, rate_bytes_s=1024.0, now_s=lambda: now_s[0]) as (_, client, node):
        client.sendall(b"y" * 3200)
        got = 0
        for tick in range(1, 101):
            now_s[0] = tick / 32  # earns 32 bytes
            got += len(receive(node, 32))
            assert not waiting(node)
        assert got == 3200


def test_a_place_that_is_taken_is_named_with_advice(server):
    taken = ("127.0.1.1", server.endpoint[1])
    with (
        socket.create_server(taken),
        pytest.raises(RelayError, match=r"io to titan.*127\.0\.1\.1.*--free-ports"),
    ):
        Relay([RelayedPair("io", "titan", taken, server.endpoint)])


def test_a_robot_whose_address_is_where_it_listens_cannot_be_relayed():
    here = ("127.0.0.1", 24400)
    with pytest.raises(RelayError, match="'listen' that differs from its 'address'"):
        Relay([RelayedPair("io", "titan", here, here)])


def test_closing_ends_the_thread_and_frees_the_ports(server):
    with relayed(server) as (relay, endpoint):
        relay.set_link("io", "titan", up=True)
        with dial(endpoint), server.accept() as node:
            relay.close()
            relay.close()
            with pytest.raises(ConnectionResetError):
                node.recv(1)
            socket.create_server(endpoint).close()
        relay.set_link("io", "titan", up=False)  # after the end: no effect
    assert not any(thread.name == "relay" for thread in threading.enumerate())
