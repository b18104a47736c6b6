"""A full database: what it takes to fill, list, compare and keep on disk 65,536 messages."""

import random
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.goals.figure import Conditions, Figure, median_ms
from mocha_link.store import Database, Header, Record, Storage

ENTRIES = 65_536  # 256 robots with 256 topics each: as many as headers can tell apart
START_MS = 1_795_000_000_000
NOW_S = START_MS / 1000 + 9000


def measure(conditions: Conditions) -> Iterator[Figure]:
    """Beside each figure what a bare loop over as many entries of a dictionary takes."""
    times = 5 if conditions.quick else 25
    records = [record(key, key * 37) for key in range(ENTRIES)]
    random.Random(1).shuffle(records)
    insert_ms = median_ms(lambda: fill(Database(), records), 3)
    database = Database()
    fill(database, records)
    held = {each.header.pack(): each for each in records}
    raws = list(held)
    anchors = {"a bare loop": median_ms(lambda: [raw for raw in raws if raw not in held], times)}
    yield Figure(f"{ENTRIES} messages inserted", insert_ms, "ms", anchors=anchors)
    fresh = iter(record(key, 5_000_000 + key) for key in range(times))

    def insert_and_list() -> None:
        database.insert(next(fresh), NOW_S)
        database.header_list()

    listed_ms = median_ms(insert_and_list, times)
    yield Figure("headers listed after another message", listed_ms, "ms", anchors=anchors)
    fill(database, [record(key, key * 37 + 6_000_000) for key in range(times)])
    for count in (0, 10, ENTRIES):
        theirs = changed(database.header_list(), count)
        compared_ms = median_ms(lambda t=theirs: database.wanted(t, NOW_S), times)
        what = f"headers compared, {count} differ"
        yield Figure(what, compared_ms, "ms", anchors=anchors)
    digests_ms = median_ms(database.digests, times)
    yield Figure("digests of all robots", digests_ms, "ms", anchors=anchors)
    yield from _on_disk(records, {"in memory": insert_ms}, 50 if conditions.quick else 500)


def _on_disk(records: list[Record], anchors: dict[str, float], times: int) -> Iterator[Figure]:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "messages.db"
        storage = Storage(path)
        database = Database(storage=storage)
        offsets_ms = iter(range(10_000_000, 11_000_000))

        def commit_one() -> None:
            database.insert(record(0, next(offsets_ms)), NOW_S)
            storage.wait()

        yield Figure("a message committed", median_ms(commit_one, times), "ms")

        def commit_all() -> None:
            fill(database, records)
            storage.wait()

        took_ms = _once_ms(commit_all)
        yield Figure(f"{len(records)} messages committed", took_ms, "ms", anchors=anchors)
        storage.close(60)
        began: list[Storage] = []

        def start() -> None:
            began.append(Storage(path))
            Database(storage=began[0])

        took_ms = _once_ms(start)
        yield Figure(f"start with {len(records)} messages", took_ms, "ms", anchors=anchors)
        began[0].close(60)


def record(key: int, offset_ms: int) -> Record:
    """A message of 100 bytes, of one of 65,536 topics."""
    stamp_ms = START_MS + offset_ms
    return Record(Header.at(key >> 8, key & 255, stamp_ms), key % 4, bytes(100), stamp_ms, NOW_S)


def fill(database: Database, records: list[Record]) -> None:
    """Insert all."""
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


def _once_ms(call: Callable[[], object]) -> float:
    began_s = time.perf_counter()
    call()
    return (time.perf_counter() - began_s) * 1e3
