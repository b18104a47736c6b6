"""Which of several addresses of a peer is dialed, and when; times are given."""

import contextlib
import socket
from collections.abc import Iterator

import pytest

from mocha_link.node.attempts import STAGGER_S, STRANGER_S, Attempts
from mocha_link.node.connection import Connection
from mocha_link.node.kernel import Poller
from tests.mocha_link.conftest import WAIT_S, own_host

REQUEST = b"123456SYNC1"
NOW_S = 1000.0


class Dialed:
    """Addresses that are tried, of which nothing stands before the test lets it."""

    def __init__(self, poller: Poller, *strangers: str) -> None:
        self.hosts: list[str] = []
        self.poller = poller
        self.attempts = Attempts(
            self.connect, poller, "titan", trusted=lambda host: host not in strangers
        )
        self.attempts.frames.append(REQUEST)
        self.port = 9

    def connect(self, host: str) -> Connection:
        self.hosts.append(host)
        return Connection(host, self.port)

    def advance(self, hosts, now_s, ready=()) -> Connection | None:
        found = self.attempts.advance(hosts, ready, now_s)
        self.attempts.settle()
        return found


@pytest.fixture
def poller() -> Iterator[Poller]:
    with contextlib.closing(Poller()) as found:
        yield found


def test_a_single_address_counts_at_once(poller):
    dialed = Dialed(poller)
    found = dialed.advance(["127.0.0.1"], NOW_S)
    assert found
    assert found.host == "127.0.0.1"
    found.close()


def test_the_next_address_is_tried_after_a_while(poller):
    dialed = Dialed(poller, "127.0.0.4")
    hosts = ["127.0.0.2", "127.0.0.3", "127.0.0.4"]
    for late_s, count in (
        (0.0, 1),
        (STAGGER_S - 0.01, 1),
        (STAGGER_S, 2),
        (2 * STAGGER_S, 2),
        (STAGGER_S + STRANGER_S, 3),  # one that anyone may have named
    ):
        assert dialed.advance(hosts, NOW_S + late_s) is None
        assert dialed.hosts == hosts[:count]
    assert dialed.attempts.wake_s == float("inf")
    dialed.attempts.close()


def test_an_address_that_refuses_is_followed_by_the_next_at_once(poller):
    refused, taken = own_host(), own_host()
    with socket.create_server((taken, 0)) as there:
        dialed = Dialed(poller, taken)
        dialed.port = there.getsockname()[1]
        assert dialed.advance([refused, taken], NOW_S) is None
        found = None
        while found is None:
            ready = poller.poll(int(WAIT_S * 1000) if dialed.attempts.wake_s > NOW_S else 0)
            found = dialed.advance([refused, taken], NOW_S, ready)
        assert found.host == taken
        assert "refused" in (dialed.attempts.failure or "")
        found.forget(poller)
        found.close()


def test_the_reason_is_that_of_the_first_address(poller):
    hosts = [own_host(), own_host()]
    dialed = Dialed(poller)
    dialed.advance(hosts, NOW_S)
    while not dialed.attempts.exhausted(hosts):
        ready = poller.poll(int(WAIT_S * 1000) if dialed.attempts.wake_s > NOW_S else 0)
        dialed.advance(hosts, NOW_S, ready)
    assert (dialed.attempts.failure or "").startswith(f"cannot connect to {hosts[0]}:9: ")
