"""`air-router ros2`: puts a flight on ROS 2."""

import argparse
import sys

from air_router.cli import say
from air_router.control import ControlClient, endpoint_of
from air_router.errors import ExitCode
from air_router.ros2.messages import FOLDER
from mocha_link.errors import needs_extra
from mocha_link.lifetime import until_terminated

_EPILOG = """\
examples:
  air-router ros2
  air-router ros2 titan --domain 7 --requests
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Say what the command does and takes."""
    parser.description = (
        "Show a flight that runs with --control on this machine to ROS 2, without a ROS "
        "installation: pose, fix, battery, state, zones, team and map as standard messages. "
        "It waits for a flight that is not there. Ctrl-C ends it, not the flight."
    )
    parser.epilog = _EPILOG
    parser.add_argument(
        "endpoint",
        nargs="?",
        type=endpoint_of,
        metavar="ENDPOINT",
        help="the flight's --control, if that has one",
    )
    parser.add_argument(
        "--domain", type=int, metavar="N", help="number of the DDS domain (ROS_DOMAIN_ID, or 0)"
    )
    parser.add_argument(
        "--requests",
        action="store_true",
        help="serve actions and services, too: every program in the DDS domain may then ask the "
        "flight to hold, resume, explore, come home, land, change its altitude, fly to points or "
        "seek a robot",
    )
    parser.add_argument(
        "--package",
        action=_Package,
        nargs=0,
        default=argparse.SUPPRESS,
        help="print the folder of the ROS package air_router_msgs, for colcon build, and exit",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run until Ctrl-C."""
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


class _Package(argparse.Action):
    """Prints where the ROS package is; needs no flight."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        sys.stdout.write(f"{FOLDER}\n")
        parser.exit()
