"""`make bench`: side-by-side measurements, as ratios to a bare loop of the same run."""

import argparse
import json
import sys

from benchmarks import database, routing, syncing


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--json", metavar="FILE", help="write the rows there as well")
    arguments = parser.parse_args()
    rows = []
    for measure in (routing.measure, syncing.measure, database.measure):
        for row in measure(quick=arguments.quick):
            rows.append(row)
            print(f"{row['what']:<58}{row['value']:>10.3g} {row['unit']:<4}{row['note']}")
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as file:  # noqa: PTH123 - a user's path
            json.dump(rows, file, indent=1)
    return 0


if __name__ == "__main__":
    sys.exit(main())
