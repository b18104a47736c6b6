"""Many nodes that all hear each other, as processes: what contacts cost, how soon news arrives.

    python -m benchmarks.fleet 2 10 30
    python -m benchmarks.fleet --way zeromq --way zenoh 10     # others that do the same
    python -m benchmarks.fleet --against ../before 30          # another checkout, in the same run

For each size: the processor, the descriptors and the memory that a node takes while nothing is
published, and the bytes of a contact with all headers; then the time from publishing to every other
robot at 100 messages a second over all, with the processor that this takes. Here nodes share cores
that each robot has for itself.
"""

import argparse
from pathlib import Path

from benchmarks.fleet.node import WAYS
from benchmarks.fleet.processes import HERE, Summary, fleet, missing, own_loopback


def line(one: Summary) -> str:
    """One line of the table."""
    return (
        f"{100 * one.idle_core_share:8.2f} {one.idle_contact_bytes_s:8.0f} {one.idle_syncs_s:8.1f} "
        f"{100 * one.busy_core_share:8.2f} {one.delay_ms(0.5):8.1f} {one.delay_ms(0.99):8.1f} "
        f"{len(one.delays_s) / one.wanted:8.0%} {one.timeouts:8} {one.descriptors:6} "
        f"{one.threads:7} {one.memory_mb:6.0f}"
    )


def main() -> None:
    """Print the table; each line is on its way for half a minute and more."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("sizes", type=int, nargs="*", default=[2, 10, 30], help="nodes, 2 to 100")
    parser.add_argument("--against", type=Path, help="another checkout, measured beside this one")
    parser.add_argument("--way", action="append", choices=tuple(WAYS), help="beside ours, too")
    options = parser.parse_args()
    runs = [("here", "mocha_link", HERE)]
    if options.against:
        runs.append((options.against.name, "mocha_link", options.against.resolve()))
    runs += [(way, way, HERE) for way in options.way or () if not missing(way)]
    if not own_loopback():
        print("no network namespace of our own: bytes are those of all programs of this machine")
    print(
        f"{'nodes':>5} {'':12} {'idle %':>8} {'bytes/s':>8} {'syncs/s':>8} {'busy %':>8} "
        f"{'p50 ms':>8} {'p99 ms':>8} {'got':>8} {'timeouts':>8} {'fds':>6} "
        f"{'threads':>7} {'MB':>6}"
    )
    for size in options.sizes:
        for name, way, checkout in runs:
            print(f"{size:5} {name:12} {line(fleet(size, way, checkout))}", flush=True)


if __name__ == "__main__":
    main()
