"""How long two gossip nodes take to sync, against a bare REQ/REP loop of the same sizes."""

import random
import socket
import statistics
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import zmq

from benchmarks.routing import row
from mocha_link import Document, ManualRadio, Node, SyncEnded, Team
from mocha_link.metrics import Direction

SIZES = ((100, 100), (100, 10_000), (10, 1_000_000))


def measure(*, quick: bool) -> Iterator[dict[str, Any]]:
    for count, size in SIZES:
        repeats = 3 if quick else 9
        node_ms = statistics.median(sync_ms(count, size) for _ in range(repeats))
        bare_ms = statistics.median(bare_req_rep_ms(count, size) for _ in range(repeats))
        note = f"{node_ms / bare_ms:.2f} x bare REQ/REP on a kept socket ({bare_ms:.1f} ms)"
        yield row(f"gossip: sync {count} messages of {size} bytes", node_ms, "ms", note)


def sync_ms(count: int, size: int) -> float:
    """One pull of `count` messages by a node that has none of them."""
    team = team_of(count)
    done = threading.Event()
    took: list[float] = []

    def on_event(event: object) -> None:
        if isinstance(event, SyncEnded) and event.direction is Direction.IN and event.messages:
            took.append(event.duration_s * 1e3)
            done.set()

    with (
        Node(team, "a", radio=ManualRadio()) as source,
        Node(team, "b", radio=ManualRadio()) as sink,
    ):
        for number in range(count):
            source.publish(f"/t{number}", noise(size, number))
        sink.subscribe(on_event)
        sink.sync("a")
        if not done.wait(60):
            raise TimeoutError("the sync did not end")
    return took[0]


def bare_req_rep_ms(count: int, size: int) -> float:
    """The same number of round trips with the same bytes, and nothing else."""
    context = zmq.Context()
    server, client = context.socket(zmq.REP), context.socket(zmq.REQ)
    port = server.bind_to_random_port("tcp://127.0.0.1")
    client.connect(f"tcp://127.0.0.1:{port}")
    answers = [noise(size, number) for number in range(count)]

    def serve() -> None:
        for answer in answers:
            server.recv()
            server.send(answer)

    thread = threading.Thread(target=serve)
    thread.start()
    began_s = time.perf_counter()
    for _ in range(count):
        client.send(b"123456GDATA123456")
        client.recv()
    took_ms = (time.perf_counter() - began_s) * 1e3
    thread.join()
    context.destroy(linger=0)
    return took_ms


def noise(size: int, seed: int) -> bytes:
    """Bytes that do not compress, so that both sides carry the same."""
    return random.Random(seed).randbytes(size)


def team_of(topics: int) -> Team:
    with socket.socket() as first, socket.socket() as second:
        for probe in (first, second):
            probe.bind(("127.0.0.1", 0))
        ports = [probe.getsockname()[1] for probe in (first, second)]
    robots = "".join(
        f"  {name}: {{kind: k, address: 127.0.0.1, base_port: {port}, clients: [{peer}]}}\n"
        for name, peer, port in zip("ab", "ba", ports, strict=True)
    )
    names = "".join(f"      - {{name: /t{n}, type: raw/Bytes}}\n" for n in range(topics))
    text = f"robots:\n{robots}kinds:\n  k:\n    topics:\n{names}"
    return Team.from_document(Document.from_text(text, Path("benchmark")))
