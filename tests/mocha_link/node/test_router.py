"""Clients that flood an open port: none fills the memory of the node, nor do several together."""

import contextlib
import errno
import os
import socket
import struct
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import zmq

from mocha_link.node import router
from mocha_link.node.kernel import Poller
from mocha_link.node.port import MAX_REQUEST_BYTES, Port
from mocha_link.node.router import HANDSHAKE_S, ClientConnection, ClientConnections
from mocha_link.node.zmtp import ZmtpSession
from mocha_link.sync.protocol import GDATA
from mocha_link.team.team import Robot
from tests.mocha_link.conftest import DATA, WAIT_S
from tests.mocha_link.node.test_port import OPEN, WAIT_MS, Shell, clients, shell, titan

__all__ = ["clients", "shell", "titan"]  # fixtures

PART = struct.pack(">BQ", 0b011, 60_000) + bytes(60_000)  # more parts follow, and a long size
SESSION = ZmtpSession(MAX_REQUEST_BYTES)
HELLO = SESSION.hello
FLOODS = 8
FLOOD_BYTES = 40_000_000  # of each
GROWTH_KB = 24 * 1024
STATUS = Path("/proc/self/status")

NODE = (DATA / "flooded_node.txt").read_text()


@pytest.fixture
def kind() -> bool:
    return OPEN


def dial(robot: Robot, peer: str = "io") -> socket.socket:
    connection = socket.create_connection((robot.listen, robot.port_for(peer)), timeout=20)
    connection.sendall(HELLO)
    return connection


def flood(robot: Robot, peer: str) -> int:
    """Messages whose parts never end, on one connection after the other; how many it took."""
    left, dials = FLOOD_BYTES, 0
    while left > 0:
        dials += 1
        with contextlib.suppress(ConnectionError), dial(robot, peer) as connection:
            while left > 0:
                connection.sendall(PART)
                left -= len(PART)
    return dials


def memory_kb(pid: int, which: str) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.split(f"{which}:")[1].split()[0])


@pytest.mark.skipif(not STATUS.is_file(), reason="the memory of a process can be read on Linux")
def test_several_floods_together_take_no_memory(field, tmp_path):
    """The highest mark of the whole process counts, not what is left of it."""
    team_file = tmp_path / "team.yaml"
    team_file.write_text(field.team.dump())
    robot = field.team.robot("titan")
    with subprocess.Popen(
        [sys.executable, "-c", NODE, str(team_file), str(FLOODS)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdin
        assert process.stdout
        assert process.stdout.readline() == "ready\n"
        before_kb = memory_kb(process.pid, "VmHWM")
        floods = [
            threading.Thread(target=flood, args=(robot, ("io", "callisto")[number % 2]))
            for number in range(FLOODS)
        ]
        for each in floods:
            each.start()
        for each in floods:
            each.join(WAIT_S)
        assert not any(each.is_alive() for each in floods)
        assert memory_kb(process.pid, "VmHWM") - before_kb < GROWTH_KB
        refused, _ = process.communicate("\n", timeout=WAIT_S)
    assert int(refused) >= FLOODS


def test_replies_that_are_not_taken_are_bounded_for_all_together(field, monkeypatch):
    """A small request for a large message, again and again, from those who read nothing."""
    size, most = 6_000_000, 10_000_000
    monkeypatch.setattr(router, "MAX_WAITING_BYTES", most)
    waited: list[int] = []
    relieved: list[int] = []
    relieve = ClientConnections.relieve

    def watched(clients: ClientConnections) -> None:
        waited.append(sum(each.waiting_bytes for each in clients.routers))
        relieve(clients)
        relieved.append(sum(each.waiting_bytes for each in clients.routers))

    monkeypatch.setattr(ClientConnections, "relieve", watched)
    node, _, _ = field.node("titan")
    header = node.publish("/map", os.urandom(size))
    request = SESSION.request(b"ididid" + GDATA + header.pack())
    with contextlib.ExitStack() as stack:
        while not node.links()["io"].refused:
            assert len(relieved) < 10_000
            greedy = stack.enter_context(dial(node.robot))
            greedy.sendall(request * 3)
            assert greedy.recv(1)
        assert most < max(waited) < most + 2 * size
        assert max(relieved) <= most
        _, _, saw = field.node("io", datagrams=False)
        assert saw.pull("titan").messages == 1
    while len(node._transport._ports.clients.routers) > 1:  # that of io, which follows
        pass


def test_who_requests_a_lot_in_a_pull_stays(shell, titan, clients):
    """Many requests on one connection, and one of the largest size."""
    client = clients.dial(titan)
    for size in (*[17] * 200, MAX_REQUEST_BYTES):
        client.send_multipart([b"", bytes(size)])
        route, (request,) = shell.request()
        assert len(request) == size
        shell.port.reply(route, b"done")
        assert client.recv_multipart() == [b"", b"done"]
    assert shell.port.expire(0.0) == []


@pytest.mark.parametrize(
    "sent",
    [
        b"GET / HTTP/1.1\r\nHost: titan\r\n\r\n",
        HELLO + struct.pack(">BQ", 2, MAX_REQUEST_BYTES + 1),
        HELLO + bytes(2) * 3000,
        HELLO + b"\x01\x00" * 200,
    ],
    ids=["no ZeroMQ", "too large", "too many", "too many parts"],
)
def test_who_sends_what_no_node_sends_is_sent_away_and_counted(shell, titan, sent):
    with socket.create_connection((titan.listen, titan.port_for("io")), timeout=20) as client:
        client.sendall(sent)
        while not (reported := shell.port.expire(0.0)):
            assert shell.turn(20) == []
        assert reported == ["a client sent an invalid request"]
        with contextlib.suppress(ConnectionError):
            while client.recv(1000):
                pass
    assert shell.port.wait_ms > 100


def test_what_was_requested_before_the_end_is_still_a_request(shell, titan):
    """A peer sends its last request and closes."""
    with dial(titan) as client:
        for number in range(3):
            client.sendall(SESSION.request(b"%d" % number))
    got = []
    while len(got) < 3:
        got += [request for _, (request,) in shell.turn(20)]
    assert got == [b"0", b"1", b"2"]
    while inside_of(shell.port):
        shell.turn(20)


def inside_of(port: Port) -> dict[bytes, ClientConnection]:
    """The connections that a port has taken, by name."""
    return port._router._inside


def inside(shell: Shell, count: int) -> None:
    """Until so many connections have made their handshake."""
    while sum(client.ready for client in inside_of(shell.port).values()) != count:
        shell.turn(20)


def test_the_oldest_of_too_many_connections_goes(shell, titan, monkeypatch):
    """The one that has sent nothing for the longest time."""
    monkeypatch.setattr(router, "MAX_CONNECTIONS", 3)
    with contextlib.ExitStack() as stack:
        clients = []
        for number in range(1, 4):
            clients.append(stack.enter_context(dial(titan)))
            inside(shell, number)
        clients[0].sendall(SESSION.request(b"?"))
        shell.request()
        stack.enter_context(dial(titan))
        while not (reported := shell.port.expire(0.0)):
            shell.turn(20)
        assert reported == ["a client connected too often"]
        with contextlib.suppress(ConnectionError):
            while clients[1].recv(1000):
                pass
        inside(shell, 3)
        clients[0].sendall(SESSION.request(b"!"))
        assert shell.request()[1] == [b"!"]


def test_all_ports_together_have_so_many(titan, monkeypatch):
    monkeypatch.setattr(router, "MAX_ALL_CONNECTIONS", 2)
    clients = ClientConnections()
    with contextlib.ExitStack() as stack:
        poller = stack.enter_context(contextlib.closing(Poller()))
        ports = {}
        reported: list[str] = []
        for number, peer in enumerate([peer for peer in titan.peers for _ in range(2)], 1):
            if peer not in ports:
                ports[peer] = stack.enter_context(
                    contextlib.closing(Port(poller, clients, titan, peer))
                )
                ports[peer].watch(poller)
            stack.enter_context(dial(titan, peer))
            while len(clients.routers) + len(reported) < number or not all(
                each.ready for each in clients.routers
            ):
                ready = poller.poll(20)
                for port in ports.values():
                    assert list(port.requests(ready)) == []
                    reported += port.expire(0.0)
        assert reported == ["a client connected too often or did not read its replies"] * 2
        first, second = ports.values()
        assert list(clients.routers.values()) == [second._router] * 2
        assert not first._router._inside


class Full:
    """A listener of a process that has no descriptor left."""

    def __init__(self, listener: socket.socket) -> None:
        self.fileno = listener.fileno

    def accept(self) -> tuple[socket.socket, object]:
        raise OSError(errno.EMFILE, "too many open files")


def test_without_descriptors_a_client_waits_and_the_node_sleeps(shell, titan, monkeypatch):
    """The listener stays ready as long as it waits: turn followed turn without an end."""
    port = shell.port
    with dial(titan):
        listener = port._router._listener
        monkeypatch.setattr(port._router, "_listener", Full(listener))
        assert listener.fileno() in shell.poller.poll(WAIT_MS)
        assert shell.turn() == []
        assert listener.fileno() not in shell.poller.poll(0)
        monkeypatch.undo()
        assert port.expire(0.0) == []
        assert listener.fileno() in shell.poller.poll(WAIT_MS)
        shell.turn()
        assert len(inside_of(port)) == 1


def test_who_sends_nothing_at_all_does_not_stay(shell, titan):
    with socket.create_connection((titan.listen, titan.port_for("io")), timeout=20):
        while not inside_of(shell.port):
            shell.turn(20)
        (client,) = inside_of(shell.port).values()
        shell.port.expire(client.began_s + HANDSHAKE_S - 1)
        assert inside_of(shell.port)
        shell.port.expire(client.began_s + HANDSHAKE_S + 1)
        assert not inside_of(shell.port)


@pytest.mark.parametrize("client_type", [zmq.REQ, zmq.DEALER])
def test_who_comes_and_goes_leaves_nothing(shell, titan, clients, client_type):
    before = set(shell.poller._selector.get_map())
    for _ in range(5):
        client = clients.dial(titan, client_type)
        client.send_multipart([b"one"] if client_type == zmq.REQ else [b"", b"one"])
        route, _ = shell.request()
        shell.port.reply(route, b"done")
        assert client.poll(WAIT_MS)
        client.recv_multipart()
        client.close(0)
    while inside_of(shell.port):
        shell.turn(20)
    assert set(shell.poller._selector.get_map()) == before
