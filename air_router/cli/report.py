"""`air-router report`: a recorded flight as one HTML page, or as JSON."""

import argparse
import sys
from pathlib import Path

from air_router.errors import ExitCode, UsageError
from air_router.files import write_whole
from air_router.record import Log, add_record, json_of, record_of
from air_router.report import history_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.description = (
        "Draw a recorded flight: track, states, contacts and syncs, bandwidth, age of "
        "information, map coverage, requests. One HTML file that needs nothing else."
    )
    parser.epilog = "example: air-router report flight-20261120T234403Z-titan.mcap -o flight.html"
    add_record(parser)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="F", help="the page (default: LOG with .html)"
    )
    parser.add_argument(
        "--json", action="store_true", help="the same as JSON on stdout, and no page without -o"
    )


def run(arguments: argparse.Namespace) -> int:
    """Draw it."""
    log = Log(record_of(arguments))
    output = arguments.output or (None if arguments.json else log.path.with_suffix(".html"))
    if output is not None:
        from air_router.report import page_of  # noqa: PLC0415 - an extra

        if output.resolve() == log.path.resolve():
            raise UsageError(f"{output}: is the record itself; write the page elsewhere, -o F")
    history = history_of(log)
    if output is not None:
        page = page_of(history, log.path.name).encode(errors="replace")  # a name may be no UTF-8
        write_whole(output, page, replace=True)
        print(f"the report: {output}", file=sys.stderr)
    if arguments.json:
        sys.stdout.write(json_of(history.as_json()) + "\n")
    return ExitCode.DONE
