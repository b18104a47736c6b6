"""Names become addresses in a thread of their own: a name server that hangs holds up no peer."""

import socket
import threading
from collections import Counter
from collections.abc import Iterator

import pytest

from mocha_link.addresses import resolver as module
from mocha_link.addresses.limits import FRESH_S, RETRY_S
from mocha_link.addresses.resolver import Resolver
from mocha_link.links.metrics import Direction, SyncTimedOut
from tests.mocha_link.conftest import no_thread_left

WAIT_S = 20


class Names:
    """A name server: what it knows, what it hangs on, and how often it was queried."""

    def __init__(self) -> None:
        self.known: dict[str, str | list[str]] = {}
        self.queried: Counter[str] = Counter()
        self.released = threading.Event()
        self.hangs: set[str] = set()
        self.threads: set[threading.Thread] = set()

    def getaddrinfo(self, host: str, *_: object) -> list[tuple]:
        self.threads.add(threading.current_thread())
        self.queried[host] += 1
        if host in self.hangs:
            assert self.released.wait(WAIT_S)
        if host not in self.known:
            raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
        known = self.known[host]
        return [
            (socket.AF_INET6, socket.SOCK_STREAM, 6, "", (each, 0, 0, 0))
            if ":" in each
            else (socket.AF_INET, socket.SOCK_STREAM, 6, "", (each, 0))
            for each in ([known] if isinstance(known, str) else known)
        ]


@pytest.fixture
def names(monkeypatch) -> Iterator[Names]:
    names = Names()
    monkeypatch.setattr(socket, "getaddrinfo", names.getaddrinfo)
    yield names
    names.released.set()
    for thread in names.threads:
        thread.join(WAIT_S)


@pytest.fixture
def time_s(monkeypatch) -> list[float]:
    """The steady time, in its only place."""
    now = [1000.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


class Woken(Resolver):
    """A resolver of which a test waits for the answers."""

    def __init__(self) -> None:
        self.answers = threading.Semaphore(0)
        super().__init__(self.answers.release)

    def wait(self) -> None:
        assert self.answers.acquire(timeout=WAIT_S)


def test_a_name_is_looked_up_once_and_wakes_when_it_is_known(names, time_s):
    names.known["titan.local"] = "10.0.0.4"
    resolver = Woken()
    assert resolver.hosts("titan.local") == ()
    resolver.wait()
    for _ in range(3):
        assert resolver.hosts("titan.local") == ("10.0.0.4",)
    assert resolver.failure("titan.local") is None
    assert names.queried == {"titan.local": 1}


def test_what_is_not_known_has_a_reason_and_is_queried_again(names, time_s):
    resolver = Woken()
    assert resolver.hosts("titan.local") == ()
    resolver.wait()
    assert resolver.hosts("titan.local") == ()
    assert "no address for 'titan.local': " in resolver.failure("titan.local")
    assert "Name or service not known" in resolver.failure("titan.local")
    time_s[0] += RETRY_S + 0.1
    names.known["titan.local"] = "10.0.0.4"
    assert resolver.hosts("titan.local") == ()
    resolver.wait()
    assert resolver.hosts("titan.local") == ("10.0.0.4",)
    assert names.queried["titan.local"] == 2


def test_an_address_that_was_good_stays_while_the_name_server_is_out_of_reach(names, time_s):
    names.known["titan.local"] = "10.0.0.4"
    resolver = Woken()
    resolver.hosts("titan.local")
    resolver.wait()
    del names.known["titan.local"]
    for _ in range(3):
        time_s[0] += FRESH_S + 1
        assert resolver.hosts("titan.local") == ("10.0.0.4",)
        resolver.wait()
        assert resolver.hosts("titan.local") == ("10.0.0.4",)
        assert resolver.failure("titan.local") is None
    names.known["titan.local"] = "10.0.0.5"
    time_s[0] += RETRY_S + 1  # queried again sooner than if all were well
    resolver.hosts("titan.local")
    resolver.wait()
    assert resolver.hosts("titan.local") == ("10.0.0.5",)


def test_a_name_is_resolved_again_when_there_are_threads_again(names, time_s):
    names.known["titan.local"] = "10.0.0.4"
    resolver = Woken()
    with no_thread_left():
        assert resolver.hosts("titan.local") == ()
    assert "cannot resolve 'titan.local': " in resolver.failure("titan.local")
    time_s[0] += RETRY_S + 0.1
    resolver.hosts("titan.local")
    resolver.wait()
    assert resolver.hosts("titan.local") == ("10.0.0.4",)


def test_a_name_may_have_addresses_of_both_kinds(names, time_s):
    names.known["titan.local"] = ["fd00::4", "::ffff:10.0.0.4", "10.0.0.4"]
    resolver = Woken()
    resolver.hosts("titan.local")
    resolver.wait()
    assert resolver.hosts("titan.local") == ("fd00::4", "10.0.0.4")


def test_a_contact_that_fails_has_the_name_resolved_anew(names, time_s):
    names.known["titan.local"] = "10.0.0.4"
    resolver = Woken()
    resolver.hosts("titan.local")
    resolver.wait()
    names.known["titan.local"] = "10.0.0.5"
    resolver.again("titan.local")  # it was resolved just now
    assert names.queried["titan.local"] == 1
    time_s[0] += RETRY_S + 0.1
    resolver.again("titan.local")
    resolver.wait()
    assert resolver.hosts("titan.local") == ("10.0.0.5",)


def test_a_node_whose_name_server_hangs_talks_to_the_others(field, names):
    """callisto's name hangs; io is reached meanwhile, and the pull from callisto times out."""
    names.hangs = {"callisto.local"}
    io, _, _ = field.node("io")
    io.publish("/pose", b"here")
    field.team = field.team.with_robots({"callisto": {"address": "callisto.local"}})
    titan, _, saw = field.node("titan", timeout_s=2)
    titan.sync("callisto")
    assert saw.pull("io").messages == 1
    broken = saw.wait(SyncTimedOut, peer="callisto", direction=Direction.IN)
    assert "no connection within 2 s" in broken.reason
    titan.close()  # quick, also while the look-up hangs
    names.released.set()


def test_a_node_reaches_a_peer_by_its_name(field, names):
    names.known["titan.local"] = field.host
    titan, _, _ = field.node("titan")
    titan.publish("/map", b"grid")
    field.team = field.team.with_robots({"titan": {"address": "titan.local"}})
    io, _, saw = field.node("io")
    assert saw.pull("titan").messages == 1
    assert io.latest("titan", "/map").data == b"grid"
