"""Which addresses a peer may have, and in which order to try them.

1. *Stated* addresses: of the team file, as a number or a host name, or else of the robot's mDNS.
2. Then those where the peer was reached before, and those its connections and datagrams came from,
   as it may have moved. With keys these are certainly the peer's. Without keys any sender can claim
   to be the peer, so they are tried only where the stated ones fail.

With keys an address decides nothing: a connection is used only if its other end proves the peer's
key.
"""

from __future__ import annotations

import time
from collections.abc import Collection

from mocha_link.addresses.limits import MAX_OF_NAME, MAX_TRIED, SEEN_S
from mocha_link.addresses.mdns import Mdns
from mocha_link.addresses.resolver import Resolver
from mocha_link.hosts import is_number
from mocha_link.team import Team


class AddressBook:
    """The addresses of the peers of a node. For one thread; no method waits for anything.

    Args:
        protected: peers whose links are encrypted.
        mdns: finds robots without an address in the team file; None: nothing does.
    """

    def __init__(
        self, team: Team, protected: Collection[str], resolver: Resolver, mdns: Mdns | None
    ) -> None:
        self._team = team
        self._protected = frozenset(protected)
        self._resolver = resolver
        self._mdns = mdns
        self._seen_s: dict[str, dict[str, float]] = {}  # by peer and address, steady seconds
        self._failed: dict[str, dict[str, None]] = {}  # by peer: addresses, the oldest first

    def hosts(self, peer: str) -> list[str]:
        """The addresses to try, in this order; empty: none is known (yet), see `failure`."""
        stated = self._stated(peer)
        seen = [host for host in self._seen(peer) if host not in stated]
        failed = list(self._failed.get(peer, ()))
        tries = [*stated, *seen]
        if len(stated) != 1:  # a single stated address stays first, even if it has failed
            tries.sort(key=lambda host: failed.index(host) + 1 if host in failed else 0)
        return tries[:MAX_TRIED]

    def _stated(self, peer: str) -> tuple[str, ...]:
        """The addresses of the team file, or else of mDNS."""
        address = self._team.robot(peer).address
        if address is None:
            return self._mdns.hosts(peer) if self._mdns else ()
        return (address,) if is_number(address) else self._resolver.hosts(address)

    def _seen(self, peer: str) -> list[str]:
        now_s = time.monotonic()
        seen = self._seen_s.get(peer, {})
        return [host for host, at_s in reversed(seen.items()) if now_s - at_s < SEEN_S]

    def is_at(self, peer: str, host: str) -> bool:
        """Whether an address is stated for a peer, or the peer was seen there recently."""
        return host in self._stated(peer) or host in self._seen(peer)

    def is_stated(self, peer: str, host: str) -> bool:
        """Whether an address is the peer's by the team file, its host name there, or mDNS."""
        return host in self._stated(peer)

    def is_trusted(self, peer: str, host: str) -> bool:
        """Whether an address may be used for a peer that has not replied from there yet.

        With keys any may: only the peer can reply as the peer. Without keys only a stated one:
        any sender can claim to be the peer.
        """
        return peer in self._protected or self.is_stated(peer, host)

    def failure(self, peer: str) -> str | None:
        """Why there is no address; None: there is one, or it may still be found."""
        address = self._team.robot(peer).address
        if address is None and self._mdns is None:
            return f"{peer} has no address in the team file"
        return None if address is None else self._resolver.failure(address)

    def came_from(self, peer: str, host: str) -> bool:
        """Note the source address of a peer; whether it is a new one: the peer may have moved.

        Without keys it may be the address of a stranger who claims to be the peer.
        """
        known = self.is_at(peer, host)
        self._note(peer, host)
        return not known

    def reached(self, peer: str, host: str) -> None:
        """Note that a peer was reached at an address."""
        self._failed.get(peer, {}).pop(host, None)
        if peer in self._protected or self.is_stated(peer, host):
            self._note(peer, host)

    def failed(self, peer: str, host: str | None = None) -> None:
        """Note a failure, if known of one address: others come first, a name is resolved anew."""
        if host is not None:
            failed = self._failed.setdefault(peer, {})
            failed.pop(host, None)
            failed[host] = None
            while len(failed) > 2 * MAX_TRIED:
                del failed[next(iter(failed))]
        address = self._team.robot(peer).address
        if address is not None and not is_number(address):
            self._resolver.again(address)

    def _note(self, peer: str, host: str) -> None:
        seen = self._seen_s.setdefault(peer, {})
        seen.pop(host, None)
        seen[host] = time.monotonic()
        while len(seen) > MAX_OF_NAME:
            del seen[next(iter(seen))]
