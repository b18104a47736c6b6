"""Robots without an address in the team file find each other by mDNS, on the loopback interface."""

import socket
import sys
import threading

import pytest

from mocha_link import DocumentError, Node
from mocha_link.addresses.limits import MAX_ANNOUNCEMENTS, MAX_OF_NAME
from mocha_link.addresses.mdns import SERVICE, Mdns
from mocha_link.errors import MissingExtraError
from mocha_link.radios import ManualRadio
from mocha_link.team import Team
from tests.mocha_link.conftest import Field, own_host

zeroconf = pytest.importorskip("zeroconf")
ifaddr = pytest.importorskip("ifaddr")

WAIT_S = 20


def without_addresses(team: Team, *names: str) -> Team:
    return team.with_robots({name: {"address": None} for name in names})


class Found:
    """Wakes a test when an address has come or gone."""

    def __init__(self, team: Team, name: str, wanted: str, **options: float) -> None:
        self.woken = threading.Semaphore(0)
        self.mdns = Mdns(
            team,
            team.robot(name),
            announces=False,
            wanted=[wanted],
            wake=self.woken.release,
            **options,
        )

    def wait(self) -> None:
        assert self.woken.acquire(timeout=WAIT_S)


def announced(robot, hosts, label="one", **properties):
    return zeroconf.ServiceInfo(
        SERVICE,
        f"{label}.{SERVICE}",
        addresses=[socket.inet_aton(host) for host in hosts],
        port=robot.base_port,
        properties={"robot": robot.name, "key": "", **properties},
        server=f"{label}.local.",
    )


def test_nodes_without_addresses_find_each_other(field: Field):
    field.team = without_addresses(field.team, "titan", "io")
    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid")
    _, _, saw = field.node("io", timeout_s=WAIT_S)
    assert saw.pull("titan").messages == 1


def test_an_announcement_of_another_robot_port_or_key_is_not_followed(field: Field):
    team = without_addresses(field.team, "titan")
    titan, io = team.robot("titan"), team.robot("io")
    found = Found(team, "io", "titan")
    with zeroconf.Zeroconf(interfaces=[own_host()]) as stranger:
        found.mdns.start()
        try:
            wrong = titan.model_copy(update={"base_port": titan.base_port + 9})
            for label, info in (
                ("port", announced(wrong, ["127.9.0.1"], "port")),
                ("robot", announced(io, ["127.9.0.2"], "robot")),
                ("key", announced(titan, ["127.9.0.3"], "key", key="x" * 40)),
                ("group", announced(titan, ["224.0.0.5", "0.0.0.0"], "group")),
            ):
                assert info.name.startswith(label)
                stranger.register_service(info)
            stranger.register_service(announced(titan, ["127.9.0.4"], "right"))
            found.wait()
            assert found.mdns.hosts("titan") == ("127.9.0.4",)
        finally:
            found.mdns.close()


def test_a_flood_of_announcements_leaves_a_few(field: Field):
    team = without_addresses(field.team, "titan")
    titan = team.robot("titan")
    found = Found(team, "io", "titan")
    count = MAX_ANNOUNCEMENTS + 4
    with zeroconf.Zeroconf(interfaces=[own_host()]) as stranger:
        found.mdns.start()
        try:
            for number in range(count):
                hosts = [f"127.9.{number}.{each}" for each in range(1, MAX_OF_NAME + 3)]
                info = announced(titan, hosts, f"n{number}")
                stranger.register_service(info, cooperating_responders=True)  # without a probe
                found.wait()
            assert len(found.mdns.hosts("titan")) == MAX_ANNOUNCEMENTS * MAX_OF_NAME
            stranger.unregister_all_services()
            found.wait()
        finally:
            found.mdns.close()


def test_a_robot_that_left_while_our_addresses_changed_is_forgotten(field: Field, monkeypatch):
    """One that is still there keeps its address."""
    team = without_addresses(field.team, "titan")
    titan, own = team.robot("titan"), ["192.0.2.1"]
    monkeypatch.setattr(
        ifaddr,
        "get_adapters",
        lambda: [ifaddr.Adapter("wlan0", "wlan0", [ifaddr.IP(own[0], 24, "wlan0")])],
    )
    found = Found(team, "io", "titan", confirm_s=4.0)
    with zeroconf.Zeroconf(interfaces=[own_host()]) as stranger:
        found.mdns.start()
        try:
            leaves, stays = (announced(titan, [f"127.9.0.{n}"], f"n{n}") for n in (1, 2))
            for info in (leaves, stays):
                stranger.register_service(info, cooperating_responders=True)
                found.wait()
            assert found.mdns.hosts("titan") == ("127.9.0.2", "127.9.0.1")
            stranger.registry.async_remove(leaves)  # its farewell is lost
            own[0] = "192.0.2.2"
            found.mdns.addresses_changed()
            found.wait()
            assert found.mdns.hosts("titan") == ("127.9.0.2",)
        finally:
            found.mdns.close()


def test_without_zeroconf_the_error_has_what_to_install(field: Field, monkeypatch):
    monkeypatch.setitem(sys.modules, "zeroconf", None)
    field.team = without_addresses(field.team, "titan")
    node = Node(field.team, "io", radio=ManualRadio())
    with pytest.raises(MissingExtraError, match=r"needs zeroconf, .*\[mdns\]"):
        node.start()
    node.close()


@pytest.mark.parametrize("address", [None, "::1"])
def test_original_nodes_need_an_address_that_they_know(field: Field, address):
    with pytest.raises(DocumentError, match=r"the original node of titan knows no (mDNS|IPv6)"):
        field.team.with_robots({"titan": {"original": True}, "io": {"address": address}})
