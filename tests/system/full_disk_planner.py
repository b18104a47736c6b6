"""A program whose node keeps its messages on a disk that fills up; prints what happened.

Run by `test_full_disk.py` with a team file and a folder on a small disk; not a test itself.
"""

import json
import queue
import random
import sys
from pathlib import Path

from mocha_link import ManualRadio, Node, StorageFailed, StorageRecovered

LIMIT_S = 60
LARGE, SMALL = 100_000, 1_000


def room_bytes(folder):
    """Fill the disk to its last byte with data of others; how much that was."""
    size = 0
    with (folder / "others").open("wb", buffering=0) as file:
        try:
            while True:
                size += file.write(bytes(4096))
        except OSError:
            return size


def main():
    team, folder, others = sys.argv[1], Path(sys.argv[2]), sys.argv[3] == "others"
    storage, noise = folder / "titan.db", random.Random(1)
    events = queue.SimpleQueue()

    def wait(kind):
        while not isinstance(events.get(timeout=LIMIT_S), kind):
            pass

    seen = {}
    with Node(team, "titan", storage=storage, radio=ManualRadio()) as node:
        node.subscribe(events.put)
        topics = [topic.name for topic in node.team.topics_of("titan")]
        seen["reserve"] = storage.with_name("titan.db-reserve").stat().st_size
        for topic in topics:
            node.publish(topic, noise.randbytes(LARGE))
            if others and topic == topics[4]:
                room_bytes(folder)
            if node.storage_fault:
                break
        wait(StorageFailed)
        seen["fault"] = node.storage_fault
        for topic in topics:
            node.publish(topic, topic.encode() * 50)
        wait(StorageRecovered)
        seen["recovered"] = node.storage_fault
        node.publish(topics[0], b"last")
    with Node(team, "titan", storage=storage, radio=ManualRadio()) as node:
        seen["kept"] = {each.topic: each.data.decode() for each in node.messages()}
        seen["fault after the restart"] = node.storage_fault
    seen["reserve again"] = storage.with_name("titan.db-reserve").exists()
    sys.stdout.write(json.dumps(seen))


if __name__ == "__main__":
    main()
