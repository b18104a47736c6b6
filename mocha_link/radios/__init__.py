"""Signal strength of peers: one adapter per radio."""

import re

from mocha_link.errors import RadioError
from mocha_link.radios.radio import ManualRadio, Radio, Report
from mocha_link.radios.rajant import RajantRadio
from mocha_link.radios.reports import MavlinkRadio, StdinRadio, TcpRadio, UdpRadio
from mocha_link.radios.wifi import WifiRadio
from mocha_link.team import RadioUrl, Robot, Team

__all__ = ["ManualRadio", "Radio", "Report", "UdpRadio", "open_radio"]

_DASHED_MAC = re.compile(r"(?:[0-9a-f]{2}-){5}[0-9a-f]{2}")


def open_radio(url: str, team: Team, robot_name: str) -> Radio:
    """The radio of a robot, not yet started. `url` is what the team file has as its `radio`.

    Raises:
        RadioError: the URL is invalid, or the team file does not identify the peers for it.
        UnknownRobotError: the team has no such robot.
    """
    robot = team.robot(robot_name)
    parsed = RadioUrl.parse(url)
    match parsed.scheme:
        case "udp":
            return UdpRadio(url)
        case "tcp":
            return TcpRadio(url)
        case "stdin":
            return StdinRadio()
        case "wifi":
            return WifiRadio(parsed, peers_by_radio(team, robot))
        case "rajant":
            return RajantRadio(parsed, peers_by_radio(team, robot))
        case _:
            return MavlinkRadio(parsed, _the_peer(parsed, robot))


def peers_by_radio(team: Team, robot: Robot) -> dict[str, str]:
    """The peers of a robot by each of the ids of their radios, in lower case.

    A `radio_id` names several radios of a robot with spaces or commas between. Raises RadioError
    if no peer has one, or two have the same.
    """
    found: dict[str, str] = {}
    for peer in robot.peers:
        for radio_id in re.split(r"[\s,]+", (team.robot(peer).radio_id or "").lower()):
            if not radio_id:
                continue
            key = radio_id.replace("-", ":") if _DASHED_MAC.fullmatch(radio_id) else radio_id
            if found.setdefault(key, peer) != peer:
                raise RadioError(
                    f"{found[key]} and {peer} have the same radio_id '{radio_id}' in {team.path}; "
                    "correct one"
                )
    if not found:
        raise RadioError(
            f"no peer of {robot.name} has a radio_id in {team.path}, so {robot.radio} cannot tell "
            "who is who; add the addresses of their radios"
        )
    return found


def _the_peer(url: RadioUrl, robot: Robot) -> str:
    peer = url.options.get("peer")
    if peer is None and len(robot.peers) == 1:
        return robot.peers[0]
    if peer not in robot.peers:
        raise RadioError(
            f"{url} must say which robot is at its other end; write ?peer= and one of "
            f"{', '.join(robot.peers) or 'the clients of ' + robot.name}"
        )
    return peer
