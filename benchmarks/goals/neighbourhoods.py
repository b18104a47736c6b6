"""Fleets of up to a hundred nodes in simulated time: how far a message gets, and at what cost."""

import time
from collections.abc import Iterator

import zmq

from benchmarks.fleet.simulated import DELAY_S, Outcome, clusters, neighbourhood
from benchmarks.goals.figure import Conditions, Figure

SIZES = (10, 30, 100)
TRIPS = 2000
SYNC_FRAMES = 4  # OPEN, HELLO, DONE, FOLLOW


def measure(conditions: Conditions) -> Iterator[Figure]:
    """One neighbourhood of each size, and clusters of it between which mules go."""
    trip_ms = round_trip_ms()
    for size in SIZES[:1] if conditions.quick else SIZES:
        near = neighbourhood(size)
        yield from _spread(near, f"{size} in reach", "half a round trip", DELAY_S)
        anchor = {"two round trips of bare ZeroMQ": SYNC_FRAMES / 2 * trip_ms}
        what = f"{size} in reach: a sync that brings nothing"
        yield Figure(what, near.empty_sync_ms, "ms", 1, anchors=anchor)
        what = f"{size} in reach: a message, per receiver"
        yield Figure(what, near.message_ms, "ms", anchors={"half a round trip": trip_ms / 2})
        far = clusters(size)
        yield from _spread(far, f"{size} in clusters", "a round trip", 2 * DELAY_S)
        anchor = {"one for each receiver": 1}
        yield Figure(f"{size} in clusters: copies sent", far.copies, "", anchors=anchor)


def _spread(outcome: Outcome, where: str, anchor: str, anchor_s: float) -> Iterator[Figure]:
    anchors = {anchor: anchor_s}
    yield Figure(f"{where}: until the last has it", outcome.spread_s[-1], "s", 2, anchors=anchors)
    crossed = {"once": 1}
    yield Figure(f"{where}: over a link at most", outcome.per_link, "times", 1, anchors=crossed)


def round_trip_ms() -> float:
    """Processor time of a request and its reply between two sockets, both sides."""
    with zmq.Context() as context, context.socket(zmq.REP) as server:
        port = server.bind_to_random_port("tcp://127.0.0.1")
        with context.socket(zmq.REQ) as client:
            client.connect(f"tcp://127.0.0.1:{port}")
            began_s = time.process_time()
            for _ in range(TRIPS):
                client.send(bytes(60))
                server.send(server.recv())
                client.recv()
            return (time.process_time() - began_s) / TRIPS * 1e3
