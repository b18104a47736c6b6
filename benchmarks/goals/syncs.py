"""How long a sync takes on one machine, against a bare REQ/REP loop of the same sizes.

The serving side is a process of its own in every case, so that both sides have a core. The
cases take turns; medians are reported, as ratios to the bare loop on a kept socket. That loop
throws away what it gets, so it works in the same memory all the time; a second one keeps it, as a
node must. New memory costs the kernel more than all else together where messages are large.
"""

import contextlib
import gc
import multiprocessing
import os
import secrets
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from multiprocessing.connection import Connection

import zmq

from benchmarks.goals.figure import Conditions, Figure
from benchmarks.link.offer import Offer
from benchmarks.link.team import PORT, SINK, SOURCE
from benchmarks.link.ways import ENDED
from benchmarks.link.ways.node import NodeSink, NodeSource
from benchmarks.link.ways.original import OriginalSource

SIZES = ((1000, 100), (100, 10_000), (100, 1_000_000))
SEED = 1
LIMIT_S = 60
# Whom we request from: a bare loop, an original node, our node; and we.
BARE = "tcp://127.77.0.1:7099"
ORIGINAL = ("127.77.1.1", "127.77.1.2")
OURS = ("127.77.2.1", "127.77.2.2")


def measure(conditions: Conditions) -> Iterator[Figure]:
    """The median of each size, our node with its like, and with what others have."""
    for count, size in SIZES[: 1 if conditions.quick else None]:
        offer = Offer.of(count, SEED, size=size)
        cases: dict[str, Callable[[], float]] = {
            "a bare REQ/REP loop": partial(bare_ms, offer),
            "one that keeps what it gets": partial(bare_ms, offer, keep=True),
            "pulled from an original node": partial(pull_ms, offer, ORIGINAL),
            "requested by a REQ socket": partial(request_ms, offer, OURS),
            "": partial(pull_ms, offer, OURS),
        }
        took: dict[str, list[float]] = {name: [] for name in cases}
        with peer(serve_bare, offer), peer(serve_original, offer), peer(serve_ours, offer):
            for _ in range(3 if conditions.quick else 11):
                for name, case in cases.items():
                    gc.collect()  # what a case leaves behind is not the next one's to clear up
                    took[name].append(case())
        medians = {name: statistics.median(values) for name, values in took.items()}
        ours_ms = medians.pop("")
        yield Figure(f"{count} x {_size(size)} pulled", ours_ms, "ms", anchors=medians)


def bare_ms(offer: Offer, *, keep: bool = False) -> float:
    """As many round trips with the same bytes, and nothing else but to keep them, perhaps."""
    got: dict[int, bytes] = {}
    with zmq.Context() as context, context.socket(zmq.REQ) as client:
        client.linger = 0
        client.connect(BARE)
        client.send(b"warm")
        client.recv()
        began_s = time.perf_counter()
        for number in range(offer.count):
            client.send(b"123456GDATA123456")
            answer = client.recv()
            if keep:
                got[number] = answer
        return (time.perf_counter() - began_s) * 1e3


def request_ms(offer: Offer, addresses: tuple[str, str]) -> float:
    """A pull as an original node does it, but on one socket."""
    with zmq.Context() as context, context.socket(zmq.REQ) as client:
        client.linger = 0
        client.connect(f"tcp://{addresses[0]}:{PORT}")

        def request(frame: bytes) -> bytes:
            client.send(secrets.token_bytes(6) + frame)
            return client.recv()[6:]

        request(b"GHEAD")
        began_s = time.perf_counter()
        headers = request(b"GHEAD")
        got = [request(b"GDATA" + headers[n : n + 6]) for n in range(0, len(headers), 6)]
        request(b"DENDT" + SINK.encode())
        took_ms = (time.perf_counter() - began_s) * 1e3
        if len(got) != offer.count:
            raise RuntimeError(f"{len(got)} of {offer.count} messages")
        return took_ms


def pull_ms(offer: Offer, addresses: tuple[str, str]) -> float:
    """One pull of everything by a new node that holds nothing."""
    ended = threading.Event()
    got: list[int] = []

    def deliver(key: int) -> None:
        if key != ENDED:
            got.append(key)
        elif len(got) == offer.count:
            ended.set()

    sink = NodeSink(offer, deliver, addresses)
    sink.start()
    try:
        began_s = time.perf_counter()
        sink.node.sync(SOURCE)
        if not ended.wait(LIMIT_S):
            raise TimeoutError(f"{len(got)} of {offer.count} messages in {LIMIT_S} s")
        return (time.perf_counter() - began_s) * 1e3
    finally:
        sink.close()


@contextlib.contextmanager
def peer(serve: Callable[[Offer, Connection], None], offer: Offer) -> Iterator[None]:
    processes = multiprocessing.get_context("spawn")
    control, theirs = processes.Pipe()
    process = processes.Process(target=serve, args=(offer, theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        control.recv()
        yield
    finally:
        control.close()
        process.join(5)
        if process.is_alive():
            process.kill()


def serve_bare(offer: Offer, control: Connection) -> None:
    answers = [b"123456" + offer.data(key) for key in range(offer.count)]
    with zmq.Context() as context, context.socket(zmq.REP) as server:
        server.linger = 0
        server.bind(BARE)
        control.send("ready")
        threading.Thread(target=_exit_at_end, args=(control,), daemon=True).start()
        while server.recv() == b"warm":
            server.send(b"")
            for answer in answers:
                server.recv()
                server.send(answer)


def serve_original(offer: Offer, control: Connection) -> None:
    _serve(OriginalSource(offer, ORIGINAL), control)


def serve_ours(offer: Offer, control: Connection) -> None:
    _serve(NodeSource(offer, OURS), control)


def _serve(side: OriginalSource | NodeSource, control: Connection) -> None:
    side.start()
    control.send("ready")
    with contextlib.suppress(EOFError):
        control.recv()
    side.close()


def _exit_at_end(control: Connection) -> None:
    with contextlib.suppress(EOFError):
        control.recv()
    os._exit(0)  # the socket belongs to the other thread, which waits in it


def _size(size: int) -> str:
    return f"{size} B" if size < 1000 else f"{size // 1000} KB" if size < 10**6 else "1 MB"
