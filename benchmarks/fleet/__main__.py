"""Fully connected nodes in separate processes: cost of a contact, and latency of messages.

    python -m benchmarks.fleet 2 10 30
    python -m benchmarks.fleet --way zeromq --way zenoh 10     # other middleware, same task
    python -m benchmarks.fleet --against ../before 30          # another checkout, in the same run

For each size: CPU, descriptors and memory of an idle node, and the bytes of a contact with all
headers; then the latency from publication to every other robot at 100 messages a second in total,
with the CPU that this takes. Here the nodes share cores; on robots each has its own.
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
    """Print the table; each line takes half a minute or more."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.fleet",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument(
        "sizes", type=int, nargs="*", default=[2, 10, 30], help="numbers of nodes, 2 to 100"
    )
    parser.add_argument("--against", type=Path, help="also measure this checkout")
    parser.add_argument(
        "--way",
        action="append",
        choices=tuple(WAYS),
        help="also measure this middleware (repeatable)",
    )
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
