"""`air-router report`: a recorded flight as one HTML page, or as JSON."""

import sys

from air_router.errors import ExitCode, UsageError
from air_router.files import write_whole
from air_router.record import Log, json_of, record_argument, record_of
from air_router.report import history_of
from mocha_link.cli import PATH, Options, command, option


@command(
    "Write the report of a recorded flight as one self-contained HTML file: track, states, "
    "contacts and syncs, bandwidth, age of information, map coverage, requests.",
    "example: air-router report flight-20261120T234403Z-titan.mcap -o flight.html",
)
@record_argument
@option(
    "-o", "--output", type=PATH, metavar="F", help="HTML file to write (default: LOG with .html)"
)
@option(
    "--json",
    is_flag=True,
    help="print the report as one JSON object on stdout; write the page only with -o",
)
def run(arguments: Options) -> int:
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
