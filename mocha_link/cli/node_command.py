"""`mocha-link node`: the node of a robot, until a signal ends it; its events on stdout."""

from __future__ import annotations

import contextlib
import json
import logging
import queue
import sys
from typing import NoReturn

import click

from mocha_link.cli.links_view import EventFilter, event_line
from mocha_link.cli.program import (
    EXAMPLE,
    PATH,
    Options,
    Parsed,
    command,
    drop_output,
    endpoint,
    examples,
    option,
    web_address,
)
from mocha_link.hosts import joined
from mocha_link.lifetime import until_terminated
from mocha_link.links import LinkEvent
from mocha_link.node import Node
from mocha_link.service import MetricsServer, PrometheusServer, ServiceServer, as_fields
from mocha_link.team import Team, keys

QUEUE_EVENTS = 10_000  # not yet printed; what comes on top is not shown
POLL_S = 1.0  # Python overlooks a signal that comes just before a wait, until that ends

LOG = logging.getLogger("mocha_link")


@command(
    "Run the gossip node of a robot until Ctrl-C or SIGTERM.",
    examples(
        "mocha-link node team.yaml --robot io",
        f"mocha-link node team.yaml --robot io --metrics {EXAMPLE} --prometheus :9464",
        "mocha-link node team.yaml --robot io --storage io.db --keys /etc/mocha-link",
        "mocha-link node team.yaml --robot io --serve ipc:///tmp/io.node",
    ),
)
@click.argument("team", type=PATH, help="team file (YAML)")
@option("--robot", metavar="NAME", required=True, help="name of this robot in the team file")
@option(
    "--metrics",
    type=Parsed(endpoint),
    metavar="ENDPOINT",
    help=f"serve metrics at this endpoint, e.g. {EXAMPLE}",
)
@option(
    "--prometheus",
    type=Parsed(web_address),
    metavar="HOST:PORT",
    help="serve metrics for Prometheus at this address, e.g. :9464 (this machine only)",
)
@option(
    "--storage",
    type=PATH,
    metavar="FILE",
    help="keep the messages in this file across restarts (default: in memory)",
)
@option(
    "--keys",
    type=PATH,
    metavar="DIR",
    help="folder with the robot's secret key, NAME.key, if the team file has a key for it",
)
@option(
    "--serve",
    type=Parsed(endpoint),
    metavar="ENDPOINT",
    help="serve bridges and other programs at this endpoint, e.g. ipc:///tmp/io.node",
)
@option(
    "--json",
    is_flag=True,
    help="print every event as a JSON line (the text output omits repeated syncs)",
)
def run(options: Options) -> int:
    """Do it; returns the exit code."""
    node = Node(Team.load(options.team), options.robot, storage=options.storage, keys=options.keys)
    events: queue.SimpleQueue[LinkEvent] = queue.SimpleQueue()  # an interrupt leaves no lock

    def keep(event: LinkEvent) -> None:  # the node must not wait for the reader of our output
        if events.qsize() < QUEUE_EVENTS:
            events.put(event)

    node.subscribe(keep)
    with until_terminated(), node, contextlib.ExitStack() as stack:
        if options.metrics:
            server = stack.enter_context(MetricsServer(node, options.metrics))
            _print_line(f"metrics on {server.endpoint}")
        if options.prometheus:
            web = stack.enter_context(PrometheusServer(node, options.prometheus))
            _print_line(f"metrics on {web.url}")
        if options.serve:
            service = stack.enter_context(ServiceServer(node, options.serve))
            _print_line(f"serves programs on {service.endpoint}")
        robot = node.robot
        exposure = keys.exposure(node.team, [robot])
        if exposure:
            LOG.warning("%s", exposure)
        if robot.original:
            LOG.warning(
                "%s has %s as an original node: the others use the old protocol "
                "with it; if this node is to stay, take 'original' away in every team file",
                options.team,
                robot.name,
            )
        if options.storage and not node.storage_fault:
            count = len(node.messages())
            _print_line(f"{options.storage} has {count} message{'s' * (count != 1)}")
        for peer in robot.peers:
            _print_line(
                f"{robot.name} answers {peer} on {joined(robot.listen, robot.port_for(peer))}"
            )
        _print_line("ready; Ctrl-C ends")
        _show(events, as_json=options.json)
    return 0


def _show(events: queue.SimpleQueue[LinkEvent], *, as_json: bool) -> NoReturn:
    event_filter = EventFilter()
    while True:
        try:
            event = events.get(timeout=POLL_S)
        except queue.Empty:
            continue
        fields = {"event": type(event).__name__, **as_fields(event)}
        if not as_json and not event_filter.is_new(fields):
            continue
        try:
            print(json.dumps(fields) if as_json else event_line(fields), flush=True)
        except OSError as error:  # its reader has closed, or the disk is full
            drop_output()
            LOG.warning("no event is printed any more (%s); the node goes on", error.strerror)


def _print_line(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
