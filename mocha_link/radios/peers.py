"""Which peer of a robot a radio's id or address is of."""

from __future__ import annotations

import ipaddress
import re

from mocha_link.errors import RadioError
from mocha_link.team import RadioUrl, Robot, Team

_DASHED_MAC = re.compile(r"(?:[0-9a-f]{2}-){5}[0-9a-f]{2}")


def peers_by_radio(team: Team, robot: Robot, *, addresses: bool = False) -> dict[str, str]:
    """The peers of a robot by each of the ids of their radios, in lower case.

    A `radio_id` names several radios of a robot with spaces or commas between.

    Args:
        team: the team.
        robot: whose peers.
        addresses: also by the IP address that others dial; IP addresses are as `ipaddress` writes
            them.

    Raises:
        RadioError: no peer has one, or two have the same.
    """
    found: dict[str, str] = {}
    for peer in robot.peers:
        other = team.robot(peer)
        ids = re.split(r"[\s,]+", (other.radio_id or "").lower())
        if addresses and other.address and as_address(other.address):
            ids.append(other.address)
        for radio_id in filter(None, ids):
            key = radio_id.replace("-", ":") if _DASHED_MAC.fullmatch(radio_id) else radio_id
            key = (as_address(key) or key) if addresses else key
            if found.setdefault(key, peer) != peer:
                raise RadioError(
                    f"{found[key]} and {peer} have the same "
                    f"{'radio_id or address' if addresses else 'radio_id'} '{radio_id}' in "
                    f"{team.path}; correct one"
                )
    if not found:
        what = "IP address or radio_id" if addresses else "radio_id"
        raise RadioError(
            f"no peer of {robot.name} has a{'n' if addresses else ''} {what} in {team.path}, so "
            f"{robot.radio} cannot tell the peers apart; add the addresses of their radios"
        )
    return found


def as_address(text: str) -> str | None:
    """An IP address in its usual form, without a zone; None: it is none."""
    try:
        return str(ipaddress.ip_address(text.partition("%")[0]))
    except ValueError:
        return None


def the_peer(url: RadioUrl, robot: Robot) -> str:
    """The peer at the other end of a radio that links to one. Raises RadioError."""
    peer = url.options.get("peer")
    if peer is None and len(robot.peers) == 1:
        return robot.peers[0]
    if peer not in robot.peers:
        raise RadioError(
            f"{url} must name the robot at its other end; write ?peer= and one of "
            f"{', '.join(robot.peers) or 'the clients of ' + robot.name}"
        )
    return peer
