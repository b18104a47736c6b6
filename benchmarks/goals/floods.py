"""Eight clients that flood a node, and the journal of a database: the memory and disk they take."""

import contextlib
import os
import socket
import sqlite3
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.fleet.processes import HERE, free_ranges
from benchmarks.goals import flooded
from benchmarks.goals.databases import NOW_S, record
from benchmarks.goals.figure import Conditions, Figure
from mocha_link.node import ZmtpSession
from mocha_link.store import Database, Storage

FLOODS, FLOOD_BYTES = 8, 40_000_000  # of each
PART = struct.pack(">BQ", 0b011, 60_000) + bytes(60_000)  # more parts follow, and a long size
WAIT_S, RESTS_S = 5.0, 2.0
MESSAGES = 65_536
TEAM = """\
robots:
  titan: {{kind: k, address: 127.0.0.1, base_port: {0}, clients: [io]}}
  io: {{kind: k, address: 127.0.0.1, base_port: {1}, clients: [titan]}}
kinds: {{k: {{topics: [{{name: /pose, type: json/Pose}}]}}}}
"""


def measure(conditions: Conditions) -> Iterator[Figure]:
    """Memory while floods last and after them, and the largest journal."""
    size = FLOOD_BYTES // 10 if conditions.quick else FLOOD_BYTES
    found = {
        "": flood_mb("node", HERE, size),
        "a ROUTER that is not read": flood_mb("", HERE, size),
    }
    if conditions.against:
        found[conditions.against.name] = flood_mb("node", conditions.against, size)
    for what, index, goal in (("at most", 0, 24), ("2 s after the last", 1, None)):
        anchors = {name: value[index] for name, value in found.items() if name}
        yield Figure(
            f"{FLOODS} floods, memory {what}", found[""][index], "MB", goal, anchors=anchors
        )
    count = MESSAGES // 8 if conditions.quick else MESSAGES
    yield Figure(
        f"journal of a database, {count} messages",
        journal_mb(_ours, count),
        "MB",
        4,
        anchors={"bare SQLite": journal_mb(_bare, count)},
    )


def flood_mb(kind: str, checkout: Path, size: int) -> tuple[float, float]:
    """By how much floods let the memory of a process grow: the most, and after they are over."""
    ports = free_ranges(2)
    with tempfile.TemporaryDirectory() as folder:
        team_file = Path(folder, "team.yaml")
        team_file.write_text(TEAM.format(*ports), encoding="utf-8")
        arguments = (kind, str(team_file)) if kind else ("router", str(ports[0]))
        with subprocess.Popen(  # noqa: S603 - ourselves
            [sys.executable, flooded.__file__, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": str(checkout)},
            text=True,
        ) as process:
            if process.stdout:
                process.stdout.readline()
            before_mb = memory_mb(process.pid, "VmHWM")
            threads = [
                threading.Thread(target=flood, args=(ports[0], size), daemon=True)
                for _ in range(FLOODS)
            ]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            most_mb = memory_mb(process.pid, "VmHWM")
            time.sleep(RESTS_S)
            after_mb = memory_mb(process.pid, "VmRSS")
            process.communicate("\n")
    return most_mb - before_mb, after_mb - before_mb


def flood(port: int, size: int) -> None:
    """A message whose parts never end, on one connection after the other, or until none is read."""
    while size > 0:
        with (
            contextlib.suppress(ConnectionError),
            socket.create_connection(("127.0.0.1", port), WAIT_S) as connection,
        ):
            connection.settimeout(WAIT_S)
            connection.sendall(ZmtpSession(1).hello)
            while size > 0:
                try:
                    connection.sendall(PART)
                except TimeoutError:
                    return
                size -= len(PART)


def memory_mb(pid: int, which: str) -> float:
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return int(status.split(f"{which}:")[1].split()[0]) / 1024


def journal_mb(write: Callable[[Path, int], Iterator[None]], count: int) -> float:
    """How large the journal beside a database gets while messages are written to it."""
    with tempfile.TemporaryDirectory() as folder:
        path, most = Path(folder, "messages.db"), 0
        journal = path.with_name(f"{path.name}-wal")
        for _ in write(path, count):
            most = max(most, journal.stat().st_size if journal.exists() else 0)
    return most / 2**20


def _ours(path: Path, count: int) -> Iterator[None]:
    storage = Storage(path)
    database = Database(storage=storage)
    for key in range(count):
        database.insert(record(key, key * 37), NOW_S)
        if key % 100 == 0:
            yield
    while not storage.wait(0.01):
        yield
    yield
    storage.close(60)


def _bare(path: Path, count: int) -> Iterator[None]:
    """In transactions of a hundred, with the journal that SQLite proposes."""
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("CREATE TABLE messages (number INTEGER PRIMARY KEY, body BLOB)")
        for key in range(count):
            connection.execute("INSERT INTO messages VALUES (?, ?)", (key, record(key, 0).body))
            if key % 100 == 0:
                connection.commit()
                yield
        connection.commit()
        yield
