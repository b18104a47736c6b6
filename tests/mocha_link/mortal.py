"""Writes messages and prints of each that it is on disk, until it is killed.

Started as a script it forks such a writer for every line that it reads, `FILE FIRST_NUMBER`: a
fresh process in no time. The writer prints its process id, then the numbers of what is committed.
"""

import os
import random
import sys
from pathlib import Path

from mocha_link.store.database import Database
from mocha_link.store.record import Knowledge, Record
from mocha_link.store.storage import Storage
from mocha_link.store.wire import Header

TOPICS = 12
DEPTH = 2
START_MS = 1_795_000_000_000


def message(number: int) -> Record:
    """The one and only message of that number."""
    chance = random.Random(number)
    stamp_ms = START_MS + number
    header = Header.at(number % 3, chance.randrange(TOPICS), stamp_ms)
    body = chance.randbytes(chance.choice((20, 500, 6000, 40_000)))
    return Record(header, chance.randrange(4), body, stamp_ms, stamp_ms / 1000)


def write(path: str, number: int) -> None:
    """Write from that number on, for ever."""
    print_line(f"pid {os.getpid()}")
    storage = Storage(Path(path))
    database = Database(dict.fromkeys(range(1 << 16), DEPTH), storage=storage)
    while True:
        record = message(number)
        database.insert(record, record.received_s)
        if number % 3 == 0:
            database.learn("io", Knowledge(1, number, database.sequence))
        if number % 4 == 0:  # the others share a transaction with the next one
            if not storage.wait():
                sys.exit(f"not on disk: {storage.fault}")
            print_line(str(number))
        number += 1


def print_line(text: str) -> None:
    """In one piece, or not at all."""
    os.write(1, f"{text}\n".encode())


if __name__ == "__main__":
    for line in sys.stdin:
        path, first = line.rsplit(maxsplit=1)
        child = os.fork()
        if child == 0:
            write(path, int(first))
        os.waitpid(child, 0)
        print_line("gone")
