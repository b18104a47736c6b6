"""`air-router ros2`: puts a flight on ROS 2."""

from pathlib import Path

import click

from air_router.cli import say
from air_router.control import ControlClient, endpoint_of
from air_router.errors import ExitCode
from air_router.files import write_whole
from air_router.record import Log
from air_router.ros2.messages import FOLDER
from mocha_link.cli import PATH, Options, Parsed, command, option
from mocha_link.errors import needs_extra
from mocha_link.lifetime import until_terminated

_EPILOG = """\
examples:
  air-router ros2
  air-router ros2 titan --domain 7 --requests
  air-router ros2 --bag flight-20261120T234403Z-titan.mcap
"""


def _print_package(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    """Print where the ROS package is; that needs no flight."""
    if wanted and not ctx.resilient_parsing:
        click.echo(FOLDER)
        ctx.exit()


@command(
    "Publish a flight on ROS 2 without a ROS installation: pose, GPS fix, battery, state, zones, "
    "team and map as standard messages. The flight runs with --control on this machine; the "
    "command waits for it. Ctrl-C ends the command, not the flight.",
    _EPILOG,
)
@click.argument(
    "endpoint",
    type=Parsed(endpoint_of),
    required=False,
    help="value of the flight's --control, if not the default",
)
@option(
    "--domain",
    type=int,
    metavar="N",
    help="DDS domain (default: ROS_DOMAIN_ID, else 0)",
)
@option(
    "--requests",
    is_flag=True,
    help="also serve actions and services: every program in the DDS domain can then command the "
    "flight to hold, resume, explore, come home, land, change altitude, fly to points or seek a "
    "robot",
)
@option(
    "--package",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_package,
    help="print the folder of the ROS package air_router_msgs, for colcon build, and exit",
)
@option(
    "--bag",
    type=PATH,
    metavar="LOG",
    help="write the messages of the recorded flight LOG to a bag (LOG with .ros2.mcap) for "
    "`ros2 bag play`, and exit",
)
def run(arguments: Options) -> int:
    """Run until Ctrl-C."""
    if arguments.bag is not None:
        return _write_bag(arguments.bag)
    with needs_extra("ROS 2", "ros2", "air-router"):
        from air_router.ros2.bridge import BY, Ros2Bridge  # noqa: PLC0415 - an extra
        from air_router.ros2.ros_graph import RosGraph  # noqa: PLC0415 - an extra
    with until_terminated(), ControlClient(arguments.endpoint, by=BY) as client:
        graph = RosGraph(arguments.domain)
        try:
            Ros2Bridge(client, graph, requests=arguments.requests, say=say).run()
        finally:
            graph.close()
    return ExitCode.DONE


def _write_bag(record: Path) -> int:
    with needs_extra("ROS 2", "ros2", "air-router"):
        from air_router.ros2.bag import ros2_mcap  # noqa: PLC0415 - an extra
    log = Log(record)
    data = ros2_mcap(log)
    if log.ending is not None:
        say(f"the record is not whole: {log.ending}")
    target = record.with_suffix(f".ros2{record.suffix}")
    write_whole(target, data, replace=True)
    say(f"the bag: {target}")
    return ExitCode.DONE
