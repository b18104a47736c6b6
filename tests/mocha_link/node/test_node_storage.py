"""Nodes with a file: what survives a restart, and what happens when the file cannot be used."""

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from mocha_link.errors import PortInUseError
from mocha_link.links.metrics import Direction, MessageStored, StorageFailed
from mocha_link.node.node import Node
from mocha_link.radios import ManualRadio
from mocha_link.store.database import Database
from mocha_link.store.storage import Storage
from mocha_link.team.keys import KeyMismatchError
from tests.mocha_link.conftest import TEAM, Field, Witness, no_thread_left

IN, OUT = Direction.IN, Direction.OUT
TRAILS = TEAM.replace("priority: medium}", "priority: medium, history: 3}")


@pytest.fixture
def file(tmp_path) -> Path:
    return tmp_path / "titan.db"


@contextlib.contextmanager
def running(field: Field, name: str, **options: object) -> Iterator[tuple[Node, Witness]]:
    """A node for some lines; a process that ends and comes again."""
    node = Node(field.team, name, **{"radio": ManualRadio(), "clock": field.clock, **options})
    witness = Witness(node)
    with node:
        yield node, witness


def test_a_node_without_a_thread_for_its_file_leaves_the_file_to_the_next(field, file):
    with no_thread_left(), pytest.raises(RuntimeError, match="start new thread"):
        Node(field.team, "titan", radio=ManualRadio(), storage=file)
    with running(field, "titan", storage=file) as (titan, _):
        titan.publish("/map", b"grid")
        assert titan.storage_fault is None


def test_messages_survive_a_restart(field_of, file):
    field = field_of(TRAILS)
    io, _, _ = field.node("io")
    for number in range(4):
        io.publish("/path", b"%d" % number)
    with running(field, "titan", storage=file) as (titan, saw):
        titan.publish("/map", b"grid")
        titan.publish("/map", b"grid 2")
        assert saw.pull("io").messages == 3
        before = titan.messages()
        stored = titan.stored_since(0)
        epoch = titan.epoch
    with running(field, "titan", storage=file) as (titan, saw):
        assert titan.messages() == before
        assert titan.latest("titan", "/map").data == b"grid 2"
        assert [m.data for m in titan.history("io", "/path")] == [b"3", b"2", b"1"]
        assert titan.stored_since(0) == stored  # other programs go on where they were
        assert titan.epoch == epoch
        ended = saw.pull("io")
        assert (ended.messages, ended.complete) == (0, True)
        titan.publish("/map", b"grid 3")
        assert titan.stored_since(stored[-1][0])[0][1].data == b"grid 3"


def test_what_has_been_published_is_on_disk(field, file, tmp_path):
    """When publish returns: a copy of the file at that moment has it."""
    with running(field, "titan", storage=file) as (titan, _):
        for number in range(5):
            titan.publish("/map", b"grid %d" % number)
            copy = tmp_path / f"copy{number}.db"
            for suffix in ("", "-wal"):
                with contextlib.suppress(FileNotFoundError):
                    shutil.copy(f"{file}{suffix}", f"{copy}{suffix}")
            assert newest_in(copy).endswith(titan.messages()[0].header.pack())


def newest_in(path: Path) -> bytes:
    storage = Storage(path)
    with contextlib.closing(storage):
        (record,) = Database(storage=storage).records()
        return record.header.pack()


def test_a_listener_may_publish(field, file):
    """It runs on the node's thread, which must not wait for the disk."""
    with running(field, "titan", storage=file) as (titan, saw):
        titan.subscribe(
            lambda event: (
                titan.publish("/slow", b"received", now=True)
                if isinstance(event, MessageStored) and event.topic == "/map"
                else None
            )
        )
        titan.publish("/map", b"grid")
        saw.wait(MessageStored, topic="/slow")
    with running(field, "titan", storage=file) as (titan, _):
        assert titan.latest("titan", "/slow").data == b"received"


def test_a_team_that_has_lost_a_topic(field_of, file):
    """What the file has of it is there no more; all else is."""
    with running(field_of(TEAM), "titan", storage=file) as (titan, _):
        titan.publish("/slow", b"old topic")
        titan.publish("/map", b"grid")
    shorter = TEAM.replace("      - {name: /slow, type: json/Pose, min_interval_s: 5}\n", "")
    assert shorter != TEAM
    field = field_of(shorter)
    io, _, saw = field.node("io")
    with running(field, "titan", storage=file) as (titan, _):
        assert [message.data for message in titan.messages()] == [b"grid"]
        for limit in (None, 1, 2):
            assert [message.data for _, message in titan.stored_since(0, limit)] == [b"grid"]
        assert saw.pull("titan").messages == 1
    assert [message.data for message in io.messages()] == [b"grid"]


def test_a_file_that_cannot_be_used_is_reported_and_done_without(field, file):
    file.write_bytes(b"something else entirely\n" * 1000)
    content = file.read_bytes()
    with running(field, "titan", storage=file) as (titan, saw):
        failed = saw.wait(StorageFailed)
        assert failed.peer == "titan"
        assert failed.at_s == field.clock.now_s()
        assert str(file) in failed.reason
        titan.publish("/map", b"grid")  # does not wait for a disk that is not there
        assert titan.latest("titan", "/map").data == b"grid"
        _, _, io_saw = field.node("io")
        assert io_saw.pull("titan").messages == 1
    assert file.read_bytes() == content  # what is there is left as it is


def test_a_node_that_cannot_be_made_gives_up_its_file(field, file):
    """The key of a robot that is no node's peer is none: all that was begun ends."""
    bad = {"callisto": {"key": "0" * 40, "clients": ["io"]}, "titan": {"clients": ["io"]}}
    field.team = field.team.with_robots(bad)
    with pytest.raises(KeyMismatchError):
        Node(field.team, "titan", storage=file)


def test_a_node_that_cannot_start_gives_up_its_file(field, file):
    """A robot's program tries again; the error is that another process has the file."""
    first, _, _ = field.node("titan")
    with (
        pytest.raises(PortInUseError),
        Node(field.team, "titan", clock=field.clock, radio=ManualRadio(), storage=file),
    ):
        pass
    first.close()
    with running(field, "titan", storage=file) as (titan, _):
        assert titan.storage_fault is None


def test_a_message_that_waits_for_its_interval_survives_the_end(field, file):
    with running(field, "titan", storage=file) as (titan, _):
        titan.publish("/slow", b"1")  # at most every 5 s
        header = titan.publish("/slow", b"2")
        assert titan.latest("titan", "/slow").data == b"1"
    with running(field, "titan", storage=file) as (titan, _):
        assert titan.latest("titan", "/slow").data == b"2"
        assert titan.latest("titan", "/slow").header == header
