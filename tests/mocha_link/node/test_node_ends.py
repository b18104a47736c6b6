"""The end of a node: within a second, whatever happens at that moment."""

import contextlib
import threading

import pytest

from mocha_link.links.metrics import SyncStarted
from mocha_link.node.node import LEAST_CLOSE_S, Node, NodeClosedError
from mocha_link.radios import ManualRadio
from mocha_link.store.storage import Storage
from tests.mocha_link.conftest import no_thread_left
from tests.mocha_link.store.test_storage import Gate, gated

WAIT_S = 60


@pytest.fixture
def first_event(monkeypatch) -> threading.Event:
    """`start` of a node does not go on before a listener has set this on the node's thread."""
    seen, real = threading.Event(), threading.Thread.start

    def start(thread: threading.Thread) -> None:
        real(thread)
        if thread.name == "mocha-link titan":
            assert seen.wait(WAIT_S)

    monkeypatch.setattr(threading.Thread, "start", start)
    return seen


def join_nodes() -> None:
    for thread in threading.enumerate():
        if thread.name.startswith("mocha"):
            thread.join(WAIT_S)


def test_a_listener_may_close_its_node_while_it_starts(field, first_event):
    """The first event can come before `start` has returned."""
    node = Node(field.team, "titan", clock=field.clock)  # pulls from all at once

    def close(_event: object) -> None:
        node.close()
        first_event.set()

    node.subscribe(close)
    node.start()
    join_nodes()
    # The fixture sees that no thread is left.


def test_a_listener_may_use_its_node_while_it_starts(field, first_event, tmp_path, monkeypatch):
    """It may request a pull, and does not wait for the disk, which would hold up the node."""
    gates: list[Gate] = []
    monkeypatch.setitem(Storage.__init__.__kwdefaults__, "connect", gated(gates))
    node = Node(
        field.team,
        "titan",
        radio=ManualRadio(),
        clock=field.clock,
        storage=tmp_path / "titan.db",
    )
    (disk,) = gates
    began: list[bool] = []

    def pull(event: object) -> None:
        if not first_event.is_set():
            began.append(node.sync("io"))
            disk.open.clear()
            node.publish("/map", b"grid")
            first_event.set()

    node.publish("/map", b"empty")  # its event waits for the node's thread
    node.subscribe(pull)
    try:
        node.start()
        assert began == [True]
    finally:
        disk.open.set()
        node.close()


def test_a_node_whose_thread_cannot_start_gives_its_ports_back(field):
    node = Node(field.team, "titan", radio=ManualRadio(), clock=field.clock)
    with no_thread_left(), pytest.raises(RuntimeError, match="thread"):
        node.start()
    with node:  # on the same ports
        pass


def test_a_node_that_is_closed_while_it_starts_leaves_nothing_open(field):
    """Another thread closes it, before or after its thread runs."""
    for _ in range(20):
        node = Node(field.team, "titan", radio=ManualRadio(), clock=field.clock)
        closing = threading.Thread(target=node.close)
        closing.start()
        with contextlib.suppress(NodeClosedError):
            node.start()
        closing.join(WAIT_S)
    join_nodes()
    with Node(field.team, "titan", radio=ManualRadio(), clock=field.clock):
        pass


def test_a_listener_that_hangs_and_a_slow_disk_do_not_add_up(field, tmp_path, monkeypatch):
    gates: list[Gate] = []
    monkeypatch.setitem(Storage.__init__.__kwdefaults__, "connect", gated(gates))
    node, _, _ = field.node("titan", storage=tmp_path / "titan.db")
    (disk,) = gates
    hanging, released = threading.Event(), threading.Event()

    def hang(event: object) -> None:
        if isinstance(event, SyncStarted):
            hanging.set()
            released.wait(WAIT_S)

    node.subscribe(hang)
    node.sync("io")
    assert hanging.wait(WAIT_S)
    disk.open.clear()
    disk.waiting.clear()
    publishing = threading.Thread(target=node.publish, args=("/map", b"grid"), daemon=True)
    publishing.start()
    assert disk.waiting.wait(WAIT_S)
    granted_s = []
    ends = Storage.close
    monkeypatch.setattr(
        Storage, "close", lambda self, limit_s: granted_s.append(limit_s) or ends(self, limit_s)
    )
    node.close()
    released.set()
    disk.open.set()
    publishing.join(WAIT_S)
    join_nodes()
    assert granted_s == [LEAST_CLOSE_S]  # the listener has had the rest


def test_a_radio_that_fails_to_close_leaves_nothing_open(field):
    """Its error is the caller's; the thread and the ports of the node end all the same."""
    node, radio, _ = field.node("titan")

    def fail() -> None:
        raise OSError("no such device")

    radio.close = fail
    with pytest.raises(OSError, match="no such device"):
        node.close()
    node.close()
    with Node(field.team, "titan", radio=ManualRadio(), clock=field.clock):
        pass
