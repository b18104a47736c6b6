"""What a program that embeds a node relies on: how it is made, awaited, logged and dropped."""

import asyncio
import gc
import logging
import socket
import subprocess
import sys
import threading
import tracemalloc
import warnings
from array import array

import numpy as np
import pytest

from mocha_link.links.link_table import LinkTable
from mocha_link.links.metrics import MessageStored, RssiChanged, SyncEnded
from mocha_link.node.broadcast import QUEUE_EVENTS, Broadcast
from mocha_link.node.node import Node, NodeClosedError
from mocha_link.radios import ManualRadio, open_radio
from mocha_link.store.wire import MAX_BYTES, PayloadError
from mocha_link.team import DocumentError, UnknownRobotError


@pytest.mark.parametrize("kind", [str, lambda path: path], ids=["text", "path"])
def test_a_node_takes_the_path_of_a_team_file(field, tmp_path, kind):
    path = tmp_path / "team.yaml"
    path.write_text(field.team.dump())
    with Node(kind(path), "titan") as node:
        assert node.team.robots == field.team.robots
        assert node.publish("/map", b"grid").robot_id == node.robot.robot_id
    with pytest.raises(DocumentError, match=r"nowhere\.yaml"):
        Node(kind(tmp_path / "nowhere.yaml"), "titan")


class TestInAsyncio:
    def test_a_node_starts_and_closes_with_the_block(self, field):
        async def live():
            async with Node(field.team, "titan", radio=ManualRadio()) as node:
                header = await node.published("/map", b"grid")
                assert node.latest("titan", "/map").header == header
            with pytest.raises(NodeClosedError):
                await node.published("/map", b"grid")

        asyncio.run(live())

    def test_the_event_loop_goes_on_while_a_message_is_on_its_way_to_the_disk(
        self, field, tmp_path
    ):
        turns = []

        async def live():
            async with Node(field.team, "titan", storage=tmp_path / "titan.db") as node:
                publishing = asyncio.create_task(node.published("/map", bytes(8_000_000)))
                while not publishing.done():
                    turns.append(None)
                    await asyncio.sleep(0)
                assert await publishing
            with Node(field.team, "titan", storage=tmp_path / "titan.db") as again:
                assert len(again.latest("titan", "/map").data) == 8_000_000

        asyncio.run(live())
        assert len(turns) > 1

    def test_a_radio_starts_and_closes_on_the_event_loop(self, field):
        threads = []

        class Modem:
            def start(self, _report):
                threads.append(threading.current_thread())
                self.task = asyncio.create_task(asyncio.sleep(100))

            def close(self):
                threads.append(threading.current_thread())
                self.task.cancel()

        async def live():
            async with Node(field.team, "titan", radio=Modem()):
                pass

        asyncio.run(live())
        assert threads == [threading.current_thread()] * 2

    def test_the_next_event_that_fits_is_the_result(self, field):
        titan, radio, _ = field.node("titan")

        async def live():
            strong = titan.wait_for(RssiChanged, lambda event: event.rssi_dbm > -50)
            radio.report("io", -90)
            radio.report("io", -40)  # before it is awaited
            assert (await strong).rssi_dbm == -40
            stored = titan.wait_for(MessageStored)
            titan.publish("/map", b"grid")
            assert (await stored).topic == "/map"

        asyncio.run(live())

    def test_a_flood_of_other_events_hides_none(self, field):
        titan, radio, _ = field.node("titan")

        async def live():
            stored = titan.wait_for(MessageStored)
            titan.publish("/map", b"grid")
            for number in range(2 * QUEUE_EVENTS):
                radio.report("io", -90 - number % 2)
            changed = titan.wait_for(RssiChanged, lambda event: event.rssi_dbm == -40)
            radio.report("io", -40)
            await changed  # all of them have been delivered
            assert (await stored).topic == "/map"

        asyncio.run(live())

    def test_a_wait_ends_with_its_time_or_with_the_node(self, field):
        titan, _, _ = field.node("titan")

        async def live():
            with pytest.raises(TimeoutError):
                await titan.wait_for(SyncEnded, timeout_s=0)
            waiting = asyncio.create_task(titan.wait_for(SyncEnded))
            await asyncio.sleep(0)
            await asyncio.to_thread(titan.close)
            with pytest.raises(NodeClosedError, match="closed before the SyncEnded"):
                await waiting

        asyncio.run(live())

    def test_an_error_in_the_condition_is_the_waiter_s(self, field):
        titan, radio, _ = field.node("titan")

        async def live():
            waiting = titan.wait_for(RssiChanged, lambda event: event.peer / 2)
            radio.report("io", -90)
            with pytest.raises(TypeError, match="unsupported operand"):
                await waiting

        asyncio.run(live())


class TestPayloads:
    @pytest.mark.parametrize("data", [b"grid", bytearray(b"grid"), memoryview(b"grid")])
    def test_bytes_of_every_kind_are_published_as_they_are_now(self, field, data):
        titan, _, _ = field.node("titan")
        titan.publish("/map", data)
        if isinstance(data, bytearray):
            data[:] = b"else"
        assert titan.latest("titan", "/map").data == b"grid"

    @pytest.mark.parametrize("data", [np.zeros(3), np.zeros(3, np.uint8), array("d"), "grid", {}])
    def test_what_a_receiver_could_not_interpret_is_a_type_error(self, field, data):
        titan, _, _ = field.node("titan")
        with pytest.raises(TypeError, match=r"/map must be bytes, not .*array\.tobytes\(\)"):
            titan.publish("/map", data)
        assert titan.latest("titan", "/map") is None

    def test_one_that_is_too_large_is_refused_before_it_is_copied(self, field):
        titan, _, _ = field.node("titan")
        data = bytearray(MAX_BYTES + 1)
        tracemalloc.start()
        with pytest.raises(PayloadError, match="at most 67108864 can be sent"):
            titan.publish("/map", data)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 1_000_000


def test_nothing_is_pulled_before_the_start(field):
    node = Node(field.team, "titan", radio=ManualRadio())
    assert node.sync("io") is False
    with pytest.raises(UnknownRobotError):
        node.sync("nobody")
    with node:
        assert node.sync("io") is True


class TestDropped:
    @pytest.mark.parametrize("stored", [False, True])
    def test_a_running_node_warns_and_gives_up_its_ports(self, field, tmp_path, stored):
        options = {"storage": tmp_path / "titan.db"} if stored else {}
        nodes = [Node(field.team, "titan", radio=ManualRadio(), **options)]
        nodes[0].start()
        nodes[0].publish("/map", b"grid")
        with pytest.warns(ResourceWarning, match="node of titan was dropped without close"):
            nodes.clear()
        with Node(field.team, "titan", **options) as again:
            assert again.storage_fault is None
            assert bool(again.latest("titan", "/map")) is stored

    def test_one_that_opened_its_storage_only_warns_too(self, field, tmp_path):
        nodes = [Node(field.team, "titan", storage=tmp_path / "titan.db")]
        with pytest.warns(ResourceWarning, match="titan"):
            nodes.clear()

    def test_one_that_was_closed_never_began_or_was_refused_does_not(self, field):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            node = Node(field.team, "titan")
            node.start()
            node.close()
            node = Node(field.team, "titan")
            with pytest.raises(UnknownRobotError):
                Node(field.team, "nobody")
            del node
            gc.collect()

    def test_a_program_may_end_with_its_node_open(self, field, tmp_path):
        path = tmp_path / "team.yaml"
        path.write_text(field.team.dump())
        script = (
            "from mocha_link import Node\n"
            f"node = Node({str(path)!r}, 'titan', storage={str(tmp_path / 'titan.db')!r})\n"
            "node.start()\nnode.publish('/map', b'grid')\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, timeout=60, check=True
        )
        assert done.stderr == b""


class TestLogs:
    def test_each_node_has_a_logger_and_its_records_name_robot_and_peer(self, field, caplog):
        titan, radio, _ = field.node("titan")
        io, _, _ = field.node("io")
        failed = threading.Event()

        def fail(_event):
            failed.set()
            raise ValueError("oops")

        titan.subscribe(fail)
        radio.report("io", -90)
        assert failed.wait(60)
        titan.close()
        io.close()
        (record,) = (each for each in caplog.records if "a listener failed" in each.message)
        assert record.name == "mocha_link.node.titan"
        assert (record.robot, record.peer) == ("titan", None)

    def test_a_line_about_a_link_names_the_peer(self, caplog):
        LinkTable(["io"], "titan").refuse("io", "damaged")
        (record,) = caplog.records
        assert record.name == "mocha_link.node.titan"
        assert (record.robot, record.peer) == ("titan", "io")

    def test_a_line_of_the_radio_names_the_robot(self, field, caplog):
        radio = open_radio(f"udp://{field.host}:0", field.team, "titan")
        node = Node(field.team, "titan", radio=radio)
        with node, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program:
            waiting = threading.Event()
            caplog.handler.addFilter(lambda _record: waiting.set() or True)
            program.sendto(b"no report", (field.host, radio.port))
            assert waiting.wait(60)
        assert ("mocha_link.node.titan", "titan") in [
            (record.name, record.robot) for record in caplog.records
        ]

    def test_a_library_prints_nothing_where_the_program_has_set_up_no_logs(self):
        script = "import mocha_link, logging; logging.getLogger('mocha_link.node.io').error('no')"
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, timeout=60, check=True
        )
        assert done.stderr == b""

    def test_a_listener_that_raises_at_every_event_is_logged_once_in_ten_seconds(self, caplog):
        now_s = 0.0
        broadcast = Broadcast(clock=lambda: now_s)

        def fail(_event):
            raise ValueError("oops")

        broadcast.subscribe(fail)
        broadcast.subscribe(fail)  # another subscription has its own line
        with caplog.at_level(logging.DEBUG):
            for _ in range(100):
                broadcast.send(RssiChanged("io", 1.0, None))
                now_s += 0.09
            assert len(caplog.records) == 2
            now_s = 10.0
            broadcast.send(RssiChanged("io", 1.0, None))
        assert len(caplog.records) == 4
        assert "test_a_listener_that_raises" in caplog.records[-1].message
        assert "(100 since the last one)" in caplog.records[-1].message
