"""Peers at IPv4 and IPv6, datagrams among them, and peers of which several addresses are known."""

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from mocha_link.addresses.limits import SEEN_S
from mocha_link.links import SyncEnded, SyncTimedOut
from mocha_link.node import Node
from mocha_link.node.dialer import Dialer
from mocha_link.node.kernel import Poller
from mocha_link.node.link_keys import LinkKeys
from mocha_link.node.port import Port
from mocha_link.node.router import ClientConnections
from mocha_link.radios import ManualRadio
from mocha_link.team import SecretKey, Team, keys
from tests.mocha_link.conftest import WAIT_S, Field, Witness, free_ports


@pytest.fixture
def poller() -> Iterator[Poller]:
    with contextlib.closing(Poller()) as found:
        yield found


def moved(team: Team, address: str | None, listen: str) -> Team:
    """Titan is at an address, the others are anywhere."""
    base = free_ports("127.0.0.1", 2)
    changes: dict[str, dict[str, object]] = {name: {"listen": "*"} for name in team.robots}
    changes["titan"] = {"address": address, "listen": listen, "base_port": base}
    return team.with_robots(changes)


def dialer_of(
    team: Team,
    poller: Poller,
    link_keys: LinkKeys | None = None,
    lost: Callable[[str, str], None] = lambda _peer, _why: None,
) -> Dialer:
    return Dialer(
        team,
        team.robot("io"),
        poller,
        keys=link_keys or LinkKeys(),
        wake=lambda: None,
        lost=lost,
    )


@pytest.mark.parametrize(
    ("address", "listen"),
    [
        ("::1", "::1"),
        ("::1", "*"),
        ("127.0.0.1", "*"),
        ("127.0.0.1", "127.0.0.1"),
        ("127.0.0.1", "0.0.0.0"),
        ("::1", "::"),
    ],
)
def test_datagrams_go_to_the_port_and_back(field, poller, address, listen):
    team = moved(field.team, address, listen)
    titan = team.robot("titan")
    dialer = dialer_of(team, poller)
    with (
        contextlib.closing(Port(poller, ClientConnections(), titan, "io")) as port,
        contextlib.closing(dialer),
    ):
        dialer.start()
        dialer.send_datagram("titan", b"there")
        port.watch(poller)
        assert port in poller.poll(WAIT_S * 1000).values()
        ((packet, port.datagram_address),) = port.packets(8)
        assert packet == b"there"
        port.send_datagram(b"and back")
        assert list(dialer.packets(poller.poll(WAIT_S * 1000))) == [("titan", b"and back")]


@pytest.mark.parametrize("listen", ["::1", "*"])
def test_nodes_meet_by_ipv6(field, listen):
    field.team = moved(field.team, "::1", listen)
    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid")
    _, _, saw = field.node("io")
    assert saw.pull("titan").messages == 1


@pytest.mark.parametrize(("listen", "other"), [("0.0.0.0", "::1"), ("::", "127.0.0.1")])
def test_a_node_of_one_family_does_not_take_the_port_of_the_other(field, poller, listen, other):
    titan = moved(field.team, "titan", listen).robot("titan")
    number = titan.port_for("io")
    with (
        contextlib.closing(Port(poller, ClientConnections(), titan, "io")),
        socket.create_server(
            (other, number), family=socket.AF_INET6 if ":" in other else socket.AF_INET
        ),
    ):
        pass


class Named:
    """The host name of titan stands for several addresses."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.hosts: tuple[str, ...] = ()
        self.fails = False
        self.threads: set[threading.Thread] = set()
        monkeypatch.setattr(socket, "getaddrinfo", self.addresses)

    def addresses(self, name: str, *_: object) -> list[tuple[object, ...]]:
        assert name == "titan.local"
        self.threads.add(threading.current_thread())
        if self.fails:
            raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (each, 0)) for each in self.hosts]


@pytest.fixture
def named(field, monkeypatch) -> Iterator[Named]:
    del field  # it ends later, and looks for threads then
    found = Named(monkeypatch)
    yield found
    for thread in found.threads:
        thread.join(WAIT_S)


def test_a_peer_is_found_at_the_second_address_of_its_name(field, named):
    named.hosts = ("127.0.0.77", field.host)  # nothing listens at the first
    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid")
    field.team = field.team.with_robots({"titan": {"address": "titan.local"}})
    _, _, saw = field.node("io")
    assert saw.pull("titan").messages == 1


def test_a_peer_is_found_again_where_its_name_points_now(field, named):
    named.hosts = (field.host,)
    here = field.team
    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid")
    field.team = here.with_robots({"titan": {"address": "titan.local"}})
    _, _, saw = field.node("io")
    assert saw.pull("titan").messages == 1
    titan.close()
    field.clock.time_s += 5
    named.hosts = ("127.0.0.78",)
    field.team = here.with_robots({"titan": {"listen": "127.0.0.78"}})
    titan, _, _ = field.node("titan")
    titan.publish("/map", b"another")
    while saw.node.latest("titan", "/map").data == b"grid":
        saw.node.sync("titan")  # the name is resolved anew at most once in a second
        saw.wait((SyncEnded, SyncTimedOut), peer="titan")
    assert saw.node.latest("titan", "/map").data == b"another"


def test_attempts_end_with_the_addresses_of_their_peer(field, named, poller, monkeypatch):
    """They leave no socket with the poller: the next one may have its number."""
    team = field.team.with_robots({"titan": {"address": "titan.local"}})
    secret, key = SecretKey.generate(), SecretKey.generate().public
    hosts, now_s, lost = ["127.0.0.80", "127.0.0.81"], [time.monotonic()], []
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    named.fails = True
    dialer = dialer_of(
        team, poller, LinkKeys(secret, {"titan": key}), lambda peer, _why: lost.append(peer)
    )
    port = team.robot("titan").port_for("io")
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.closing(dialer))
        for host in hosts:
            stack.enter_context(socket.create_server((host, port)))  # has no key to show
        for _ in range(2):
            for host in hosts:
                dialer.book.came_from("titan", host)  # some minutes ago
            dialer.connect("titan")
            dialer.send("titan", b"123456SYNC1")
            assert "titan" in poller.poll(WAIT_S * 1000).values()
            now_s[0] += SEEN_S + 1
            dialer.book.hosts("titan")  # has the name resolved
            while dialer.book.failure("titan") is None:
                pass
            dialer.send("titan", b"123456SYNC1")
            assert poller.poll(0) == {}
    assert lost == ["titan", "titan"]


def test_with_keys_what_only_takes_connections_holds_up_nothing(field: Field, named, tmp_path):
    """Whoever may be at an address of the peer's name: it has to show the peer's key."""
    for name in ("titan", "io"):
        secret = SecretKey.generate()
        field.team = field.team.with_robots({name: {"key": secret.public.text}})
        keys.write(tmp_path / f"{name}.key", name, secret)
    port = field.team.robot("titan").port_for("io")
    named.hosts = ("127.0.0.79", field.host)
    with (
        socket.create_server(("127.0.0.79", port)) as silent,
        Node(field.team, "titan", radio=ManualRadio(), keys=tmp_path) as titan,
    ):
        titan.publish("/map", b"grid")
        team = field.team.with_robots({"titan": {"address": "titan.local"}})
        io = Node(team, "io", radio=ManualRadio(), keys=tmp_path)
        saw = Witness(io)
        with io:
            assert saw.pull("titan").messages == 1
        silent.settimeout(WAIT_S)
        silent.accept()[0].close()  # it was tried
