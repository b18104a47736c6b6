"""`make bench-goals`: every figure that a user feels, its goal, and an anchor in the same run.

python -m benchmarks.goals                       # all, a quarter of an hour on two idle cores
python -m benchmarks.goals --busy                # beside three busy loops
python -m benchmarks.goals --only routes --only floods
python -m benchmarks.goals --json FILE           # keeps what FILE has of the others
python -m benchmarks.goals --json FILE --left    # only what FILE lacks
python -m benchmarks.goals --against ../before   # another checkout as one more anchor
"""

import argparse
import contextlib
import json
import multiprocessing
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks.goals import page
from benchmarks.goals.figure import HEAD, Conditions, Figure, missed
from benchmarks.goals.groups import GROUPS, figures_of
from benchmarks.link.load import Load, busy_loops


def main(argv: Sequence[str] | None = None) -> int:
    options = _options(argv)
    conditions = Conditions(
        options.quick, options.busy, options.against and options.against.resolve()
    )
    where = "busy" if options.busy else "idle"
    kept: dict[str, dict[str, Any]] = {}
    if options.json and options.json.exists():
        kept = json.loads(options.json.read_text(encoding="utf-8"))
    if options.docs:
        page.write(options.docs, kept)
        return 0
    names = [
        name
        for name in options.only or GROUPS
        if not (options.left and name in kept.get(where, {}))
    ]
    print(HEAD)
    failed, unmeasured = 0, []
    for name in names:
        load = Load()
        with busy_loops() if options.busy else contextlib.nullcontext():
            figures, why = _measured(name, conditions)
        waited = "" if load.waiting is None else f", some program waited {load.waiting:.0%} of it"
        print(f"-- {name}: {load.lasted_s:.0f} s{waited}")
        for figure in figures:
            print("\n".join(figure.lines()), flush=True)
        failed += missed(figures)
        if why:
            print(f"{name}: {why}", file=sys.stderr)
            unmeasured.append(name)
        elif options.json:
            kept.setdefault(where, {})[name] = {
                "measured": datetime.now(UTC).isoformat(timespec="minutes"),
                "cores": os.cpu_count(),
                "waiting": load.waiting,
                "quick": options.quick,
                "figures": [figure.as_row() for figure in figures],
            }
            options.json.write_text(json.dumps(kept, indent=1), encoding="utf-8")
    print(f"{failed} goals missed" + "".join(f"; {name} not measured" for name in unmeasured))
    return 1 if unmeasured else 0


def _measured(name: str, conditions: Conditions) -> tuple[list[Figure], str]:
    """One group in a process of its own, which may leave the machine's network."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(figures_of, name, conditions).result()


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.goals",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--only", metavar="NAME", action="append", choices=GROUPS, help=", ".join(GROUPS))
    add("--quick", action="store_true", help="the smallest sizes, to see that it works")
    add("--busy", action="store_true", help="beside three busy loops")
    add("--against", metavar="CHECKOUT", type=Path, help="another checkout as one more anchor")
    add("--json", metavar="FILE", type=Path, help="write all figures there as well")
    add("--left", action="store_true", help="only what FILE lacks under these conditions")
    add("--docs", metavar="PAGE", type=Path, help="write the table of FILE into this page")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
