"""`mocha-link metrics`: the links of a running node, and what happens on them."""

from __future__ import annotations

import json
import time

import click

from mocha_link.cli.links_view import UNREADABLE, EventFilter, NodeView, Style, event_line
from mocha_link.cli.program import (
    EXAMPLE,
    Options,
    Parsed,
    command,
    endpoint,
    examples,
    option,
    seconds,
)
from mocha_link.service import MetricsError, watch


@command(
    "Show the links of a running node.",
    examples(f"mocha-link metrics {EXAMPLE}", f"mocha-link metrics {EXAMPLE} --json --follow"),
)
@click.argument("endpoint", type=Parsed(endpoint), help="endpoint of the node's --metrics")
@option("--json", is_flag=True, help="print JSON, one object per line")
@option("--follow", is_flag=True, help="keep printing events as they happen")
@option(
    "--timeout",
    type=Parsed(seconds),
    metavar="S",
    default=5.0,
    help="time to wait for the node, in seconds (default 5)",
)
def run(options: Options) -> int:
    """Do it; returns the exit code."""
    picture, event_filter, shown = NodeView(options.endpoint), EventFilter(), False
    for kind, fields in watch(options.endpoint, timeout_s=options.timeout):
        text = ""
        try:
            if kind == "links":
                picture.take(kind, fields, time.monotonic())
                text = "" if shown else picture.printed(Style(colour=False))
                shown = True
            elif event_filter.is_new(fields):
                text = event_line(fields)
        except UNREADABLE:
            raise MetricsError(f"what {options.endpoint} sends is not a node's metrics") from None
        if options.json or text:
            print(json.dumps(fields) if options.json else text, flush=True)
        if shown and not options.follow:
            break
    return 0
