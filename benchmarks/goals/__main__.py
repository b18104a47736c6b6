"""`make bench-goals`: performance figures that users notice, with target and reference.

A reference is measured in the same run, so that figures of different machines can be compared.

python -m benchmarks.goals                       # all, 15 minutes on two idle cores
python -m benchmarks.goals --busy                # with three busy loops in the background
python -m benchmarks.goals --only routes --only floods
python -m benchmarks.goals --json FILE           # update FILE; other figures in it are kept
python -m benchmarks.goals --json FILE --left    # measure only figures missing in FILE
python -m benchmarks.goals --against ../before   # another checkout as a further reference
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
    add(
        "--only",
        metavar="NAME",
        action="append",
        choices=GROUPS,
        help=f"measure only this group (repeatable): {', '.join(GROUPS)}",
    )
    add("--quick", action="store_true", help="smallest sizes, as a smoke test")
    add("--busy", action="store_true", help="with three busy loops in the background")
    add("--against", metavar="CHECKOUT", type=Path, help="another checkout as a further reference")
    add("--json", metavar="FILE", type=Path, help="also write all figures to FILE")
    add(
        "--left",
        action="store_true",
        help="measure only figures that FILE lacks for these conditions",
    )
    add("--docs", metavar="PAGE", type=Path, help="write the table of FILE into PAGE")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
