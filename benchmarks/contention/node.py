"""One robot's node as a process: it reads commands from stdin, and reports pulls on stdout.

    node.py TEAM ROBOT

A line is a JSON list: `["publish", topic, data as hex]`, or `["pull", peer]`. It prints `["ready"]`
once, and `["ended", peer, whether it was complete]` for every pull.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from benchmarks.link.namespaces import end_with_parent
from mocha_link import LinkEvent, ManualRadio, Node
from mocha_link.links import Direction, SyncEnded, SyncTimedOut

SILENT_S = 3600.0
"""A pull that waits for its turn is not given up: who loses contact is hung up on by the relay."""


def report(*what: object) -> None:
    """Print a line, at once."""
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def main() -> None:
    """Run the node until stdin ends."""
    end_with_parent()
    team, name = sys.argv[1:3]

    def happened(event: LinkEvent) -> None:
        if isinstance(event, SyncEnded | SyncTimedOut) and event.direction is Direction.IN:
            report("ended", event.peer, isinstance(event, SyncEnded))

    timeout_s = float(sys.argv[3]) if len(sys.argv) > 3 else SILENT_S
    with Node(Path(team), name, radio=ManualRadio(), timeout_s=timeout_s, datagrams=False) as node:
        node.subscribe(happened)
        report("ready")
        for line in sys.stdin:
            match json.loads(line):
                case ["publish", topic, data]:
                    node.publish(topic, bytes.fromhex(data), now=True)
                case ["pull", peer]:
                    if not node.sync(peer):
                        report("ended", peer, False)


if __name__ == "__main__":
    main()
