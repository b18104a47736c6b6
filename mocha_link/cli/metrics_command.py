"""`mocha-link metrics`: the links of a running node, and what happens on them."""

from __future__ import annotations

import argparse
import json
import time

from mocha_link.cli.links_view import UNREADABLE, EventFilter, NodeView, Style, event_line
from mocha_link.cli.program import EXAMPLE, endpoint, examples, seconds
from mocha_link.service import MetricsError, watch


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.epilog = examples(
        f"mocha-link metrics {EXAMPLE}", f"mocha-link metrics {EXAMPLE} --json --follow"
    )
    parser.add_argument(
        "endpoint", type=endpoint, metavar="ENDPOINT", help="what the node got as --metrics"
    )
    parser.add_argument("--json", action="store_true", help="print JSON, one object per line")
    parser.add_argument("--follow", action="store_true", help="go on with events as they happen")
    parser.add_argument(
        "--timeout", type=seconds, default=5.0, metavar="S", help="wait so long, in s (5)"
    )


def run(options: argparse.Namespace) -> int:
    """Do it; returns the exit code."""
    picture, news, shown = NodeView(options.endpoint), EventFilter(), False
    for kind, fields in watch(options.endpoint, timeout_s=options.timeout):
        text = ""
        try:
            if kind == "links":
                picture.take(kind, fields, time.monotonic())
                text = "" if shown else picture.printed(Style(colour=False))
                shown = True
            elif news.is_new(fields):
                text = event_line(fields)
        except UNREADABLE:
            raise MetricsError(f"what {options.endpoint} sends is not a node's metrics") from None
        if options.json or text:
            print(json.dumps(fields) if options.json else text, flush=True)
        if shown and not options.follow:
            break
    return 0
