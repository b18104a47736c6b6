"""What a full database costs: header lists, comparisons, lookups; ratios to a bare dict loop."""

import random
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.routing import row
from mocha_link.store import Database, Header, Record, Storage

ENTRIES = 65_536  # 256 robots with 256 topics each: as many as headers can tell apart
START_MS = 1_795_000_000_000
NOW_S = START_MS / 1000 + 9000


def measure(*, quick: bool) -> Iterator[dict[str, Any]]:
    times = 5 if quick else 25
    records = [record(key, key * 37) for key in range(ENTRIES)]
    random.Random(1).shuffle(records)
    database = Database()
    insert_ms = median_ms(lambda: fill(Database(), records), 3)
    fill(database, records)
    cold_ms = median_ms(database.header_list, 1)
    ours = database.header_list()

    held = {each.header.pack(): each for each in records}
    raws = [each.header.pack() for each in records]
    bare_ms = median_ms(lambda: [raw for raw in raws if raw not in held], times)

    def line(what: str, value_ms: float) -> dict[str, Any]:
        note = f"{value_ms / bare_ms:.2g} x a bare dict loop over {ENTRIES} ({bare_ms:.1f} ms)"
        return row(f"database: {what}", value_ms, "ms", note)

    yield line(f"insert {ENTRIES} messages", insert_ms)
    yield line("header list, the first", cold_ms)
    yield line("header list", median_ms(database.header_list, times))

    fresh = iter(record(key, 5_000_000 + key) for key in range(times))

    def insert_and_list() -> None:
        database.insert(next(fresh), NOW_S)
        database.header_list()

    yield line("header list after another message", median_ms(insert_and_list, times))
    fill(database, [record(key, key * 37 + 6_000_000) for key in range(times)])

    for count in (0, 10, ENTRIES):
        theirs = changed(database.header_list(), count)
        wanted_ms = median_ms(lambda t=theirs: database.wanted(t, NOW_S), times)
        found = len(database.wanted(theirs, NOW_S))
        yield line(f"compare {ENTRIES} headers, {found} differ", wanted_ms)
    older = b"".join(record(key, -5_000_000 + key).header.pack() for key in range(ENTRIES))
    yield line("the same, all are older", median_ms(lambda: database.wanted(older, NOW_S), times))
    yield line("digests of all robots", median_ms(database.digests, times))
    number = database.sequence - 10
    yield line("what came after a number (10)", median_ms(lambda: database.since(number), times))

    headers = [Header.parse(ours[at : at + 6]) for at in range(0, len(ours), 6)]
    small = Database()
    fill(small, records[:16])
    look_up_ms = median_ms(lambda: [database.get(header) for header in headers], times)
    few = [each.header for each in records[:16]] * (len(headers) // 16)
    small_ms = median_ms(lambda: [small.get(header) for header in few], times)
    note = f"{look_up_ms / small_ms:.2g} x in a database of 16, which fits the CPU's cache"
    yield row("database: look up one header", look_up_ms / len(headers) * 1e3, "us", note)
    yield from on_disk(records, insert_ms, quick=quick)


def on_disk(records: list[Record], insert_ms: float, *, quick: bool) -> Iterator[dict[str, Any]]:
    with tempfile.TemporaryDirectory() as directory:
        storage = Storage(Path(directory) / "messages.db")
        database = Database(storage=storage)

        offsets_ms = iter(range(10_000_000, 11_000_000))

        def commit_one() -> None:
            database.insert(record(0, next(offsets_ms)), NOW_S)
            storage.wait()

        one_ms = median_ms(commit_one, 50 if quick else 500)
        yield row("database on disk: one message, committed", one_ms, "ms")
        began_s = time.perf_counter()
        fill(database, records)
        storage.wait()
        took_ms = (time.perf_counter() - began_s) * 1e3
        note = f"{took_ms / insert_ms:.2g} x in memory"
        yield row(f"database on disk: {ENTRIES} messages, committed", took_ms, "ms", note)
        storage.close(60)
        began_s = time.perf_counter()
        storage = Storage(Path(directory) / "messages.db")
        Database(storage=storage)
        took_ms = (time.perf_counter() - began_s) * 1e3
        yield row(f"database on disk: start with {ENTRIES} messages", took_ms, "ms")
        storage.close(60)


def record(key: int, offset_ms: int) -> Record:
    stamp_ms = START_MS + offset_ms
    return Record(Header.at(key >> 8, key & 255, stamp_ms), key % 4, bytes(100), stamp_ms, NOW_S)


def fill(database: Database, records: list[Record]) -> None:
    for each in records:
        database.insert(each, NOW_S)


def changed(headers: bytes, count: int) -> bytes:
    """The list of a peer that has a newer message of `count` topics."""
    result = bytearray(headers)
    for place in random.Random(2).sample(range(ENTRIES), count):
        robot_id, topic_id = headers[place * 6], headers[place * 6 + 1]
        newer = Header.at(robot_id, topic_id, START_MS + 9_000_000 + place)
        result[place * 6 : place * 6 + 6] = newer.pack()
    return bytes(result)


def median_ms(function: Callable[[], object], times: int) -> float:
    values = []
    for _ in range(times):
        began_s = time.perf_counter()
        function()
        values.append((time.perf_counter() - began_s) * 1e3)
    return statistics.median(values)
