"""What belongs to each peer of a node: what is known of it, who asks it, who answers it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from mocha_link.links.link_table import LinkTable
from mocha_link.store.signature import Verifier
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import NodeContext
from mocha_link.sync.puller import Puller
from mocha_link.sync.server import Server
from mocha_link.team.team import Robot, Trust


@dataclass(slots=True)
class PeerLink:
    """What belongs to one peer."""

    peer: Peer
    puller: Puller
    server: Server
    differs: bool = False  # its team file is another one, as was told


def peer_links(
    context: NodeContext, me: Robot, link_table: LinkTable, *, datagrams: bool
) -> dict[str, PeerLink]:
    """The links of a robot by peer; messages are verified if the team has keys or demands them.

    Raises:
        KeyMismatchError: a key in the team file is none.
        KeysUnavailableError: the team has keys, and PyNaCl is missing.
    """
    team = context.team
    verifier = Verifier(team)
    verifies = team.trust is Trust.SIGNED or any(robot.key for robot in team.robots.values())
    links = {}
    for name in me.peers:
        peer = Peer(
            name,
            context,
            verify=partial(verifier.verify, handed_by=name) if verifies else None,
            original=team.robot(name).original,
            datagrams=datagrams,
            budget_bytes=team.trigger.budget_bytes or 0,
            pushed=team.pushed(me, name),
        )
        links[name] = PeerLink(peer, Puller(peer, link_table), Server(peer))
    return links
