"""`mocha-link doctor`: why two robots do not talk, found out by trying, on one page."""

from __future__ import annotations

import json
import queue
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, closing, nullcontext
from pathlib import Path
from typing import NamedTuple

import click

from mocha_link.addresses import Resolver
from mocha_link.cli.program import PATH, Options, Parsed, command, examples, option, seconds
from mocha_link.clock import Instant
from mocha_link.errors import ListenError, PortInUseError, RadioError
from mocha_link.hosts import is_number, joined
from mocha_link.links import (
    Direction,
    LinkEvent,
    Reading,
    SyncEnded,
    SyncTimedOut,
    as_reading,
    threshold,
)
from mocha_link.node import Gossip, Transport, kernel
from mocha_link.radios import open_radio
from mocha_link.team import Robot, SecretKey, Team, peer_keys, secret_key

LISTEN_S = 8.0  # four intervals of nodes that pull by the timer
RESOLVE_S = 3.0  # for the name of this computer
GREET_S = 1.0  # for a node at its address
AHEAD_S = 1.0  # clocks closer than that do no harm
IN, OUT = Direction.IN, Direction.OUT


class Finding(NamedTuple):
    """One thing that was tried: about which peer (None: this computer), and what came of it."""

    peer: str | None
    good: bool
    text: str


@command(
    "Test the links of robot NAME on its own computer: send requests to every peer, wait for "
    "requests from every peer, and read the radio's reports. Publishes nothing. A node of NAME may "
    "keep running, but its pulls are interrupted. Exit code 1: a problem was found.",
    examples("mocha-link doctor team.yaml --robot io"),
)
@click.argument("team", type=PATH, help="team file (YAML)")
@option("--robot", metavar="NAME", required=True, help="name of this robot in the team file")
@option(
    "--keys",
    type=PATH,
    metavar="DIR",
    help="folder with the secret key NAME.key, if the team has keys",
)
@option(
    "--seconds",
    type=Parsed(seconds),
    metavar="S",
    default=LISTEN_S,
    help="longest time to wait and listen, in seconds (default 8)",
)
@option("--json", is_flag=True, help="print one JSON object on stdout")
def run(options: Options) -> int:
    """Do it; returns the exit code."""
    team = Team.load(options.team)
    findings = diagnose(team, options.robot, keys=options.keys, seconds=options.seconds)
    good = all(finding.good for finding in findings)
    if options.json:
        print(json.dumps({"good": good, "findings": [each._asdict() for each in findings]}))
        return 0 if good else 1
    for peer in (None, *team.robot(options.robot).peers):
        print(peer or f"{options.robot}, here")
        for finding in findings:
            if finding.peer == peer:
                print(f"  {'ok ' if finding.good else 'BAD'}  {finding.text}")
    return 0 if good else 1


def diagnose(
    team: Team, name: str, *, keys: Path | None = None, seconds: float = LISTEN_S
) -> list[Finding]:
    """What is in the way of a robot and its peers, tried for so long at most.

    Raises:
        UnknownRobotError: the team has no robot of that name.
        KeyFileError, KeyMismatchError, KeysUnavailableError: as `Node` does.
    """
    trial = _Trial(team, team.robot(name), secret_key(team, name, keys), seconds)
    trial.run()
    return trial.findings


class _Trial:
    """Pulls from every peer, serves pulls, and reads the radio, for a few seconds."""

    def __init__(self, team: Team, robot: Robot, secret: SecretKey | None, seconds: float) -> None:
        self.findings: list[Finding] = []  # in the order of the page
        self._team = team
        self._robot = robot  # the one that this computer is
        self._secret = secret  # of that robot
        self._seconds = seconds  # how long at most
        self._gossip = Gossip(
            team,
            robot.name,
            by_timer=True,
            timeout_s=seconds / 2,
            follow=False,
            both_ways=False,  # each direction is tried by itself
            trial=True,  # the robot's own node may run beside it
        )
        self._events: queue.SimpleQueue[LinkEvent] = queue.SimpleQueue()
        self._readings: dict[str, Reading | None] = {}  # of the radio, by peer
        self._ends: dict[tuple[str, Direction], SyncEnded | SyncTimedOut] = {}  # the newest
        self._serves = True  # peers can pull: the ports are ours
        self._has_node = False  # its node runs beside us
        self._owns_radio = robot.radio is not None  # its radio is ours

    def run(self) -> None:
        """Try it all, then judge."""
        with closing(self._transport()), self._radio():
            self.findings.extend(self._own_address())
            self._watch()
        for peer in self._robot.peers:
            self.findings.append(self._outgoing(peer))
            if self._serves:
                self.findings.append(self._incoming(peer))
            self.findings.extend(self._identity(peer))
            self.findings.extend(self._clock(peer))
            if self._owns_radio:
                self.findings.append(self._signal(peer))

    def _transport(self) -> Transport:
        """With the robot's ports, or without if a node has them."""
        lock = threading.Lock()
        while True:
            transport = Transport(
                self._gossip,
                self._team,
                lock=lock,
                now=_now,
                deliver=self._events.put,
                secret=self._secret,
                keys=peer_keys(self._team, self._robot) if self._secret else {},
                serves=self._serves,
            )
            try:
                transport.start()
            except PortInUseError:
                text = (
                    f"the ports of {self._robot.name} are taken, by its node no doubt: "
                    "'mocha-link monitor' shows who pulls from it ('out')"
                )
                self.findings.append(Finding(None, True, text))
                self._has_node = True
            except ListenError as error:
                self.findings.append(Finding(None, False, str(error)))
            else:
                if self._serves:
                    ports = ", ".join(str(self._robot.port_for(p)) for p in self._robot.peers)
                    text = f"listens on {self._robot.listen}: {ports}"
                    self.findings.append(Finding(None, True, text))
                return transport
            self._serves = False

    def _own_address(self) -> Iterator[Finding]:
        """Whether the others dial this computer, or another one that may run as the same robot."""
        name, address = self._robot.name, self._robot.address
        if address is None or not self._robot.peers:
            return
        hosts, why = _resolved(address, min(self._seconds, RESOLVE_S))
        if not hosts:
            yield Finding(None, False, f"its address in the team file: {why}")
        elif not any(map(kernel.is_ours, hosts)):
            text = f"'{address}' in the team file is no address of this computer"
            port = self._robot.port_for(self._robot.peers[0])
            if any(_greets(host, port) for host in hosts):
                text += (
                    f", and a node answers there: two robots run as {name}, which loses messages "
                    "of both, or a relay or NAT leads from there to here; give each robot a name "
                    "of its own"
                )
            else:
                text += f": the others do not find {name}; correct the address, or this computer's"
            yield Finding(None, False, text)

    def _radio(self) -> AbstractContextManager[object]:
        """While it listens to the radio, if there is one that is ours."""
        if self._robot.radio is None:
            return nullcontext()
        try:
            radio = open_radio(self._robot.radio, self._team, self._robot.name)
            radio.start(lambda peer, reading: self._readings.update({peer: as_reading(reading)}))
        except RadioError as error:
            text = "its node reads the radio: 'mocha-link monitor' shows the signals"
            found = Finding(None, self._has_node, text if self._has_node else f"radio: {error}")
            self.findings.append(found)
            self._owns_radio = False
            return nullcontext()
        return closing(radio)

    def _watch(self) -> None:
        """Wait until the pulls to and from every peer have succeeded, or the time is over."""
        wanted = {(peer, IN) for peer in self._robot.peers}
        if self._serves:
            wanted |= {(peer, OUT) for peer in self._robot.peers}
        until_s = time.monotonic() + self._seconds
        while wanted or self._owns_radio:
            try:
                event = self._events.get(timeout=max(until_s - time.monotonic(), 0.0))
            except queue.Empty:
                return
            if isinstance(event, SyncEnded | SyncTimedOut):
                self._ends[event.peer, event.direction] = event
                if isinstance(event, SyncEnded):
                    wanted.discard((event.peer, event.direction))

    def _outgoing(self, peer: str) -> Finding:
        robot = self._team.robot(peer)
        number = robot.port_for(self._robot.name)
        place = joined(robot.address, number) if robot.address else f"port {number} (by mDNS)"
        end = self._ends.get((peer, IN))
        if isinstance(end, SyncEnded):
            link = self._gossip.links(_now())[peer]
            rtt = "" if link.rtt_s is None else f", round trip {link.rtt_s * 1000:.1f} ms"
            kind = "an original node" if link.path == "original" else "a node"
            return Finding(peer, True, f"{kind} answers at {place}{rtt}")
        why = end.reason if end else f"no answer within {self._seconds:g} s"
        hint = ""
        if "refused" in why and "key" not in why:
            hint = (
                f"; {robot.address or peer} is reached, but no node of {peer} listens at that "
                "port: start it, or compare base_port in the two team files"
            )
        elif robot.address is None:
            hint = (
                f"; is the node of {peer} on, on the same link as this computer, and does the link "
                "carry multicast (mDNS, UDP port 5353)? Otherwise add its address to the team file"
            )
        elif end is None or "no connection" in why or "unreachable" in why or "no route" in why:
            hint = (
                f"; is {peer} on and in range ('ping {robot.address}'), is that its address, and "
                "does a firewall on the way or there let TCP and UDP through?"
            )
        elif "no byte" in why:
            hint = f"; something takes connections there that is no node of {peer}, or hangs"
        return Finding(peer, False, f"pull from {place}: {why}{hint}")

    def _incoming(self, peer: str) -> Finding:
        end, port = self._ends.get((peer, OUT)), self._robot.port_for(peer)
        if end is None:
            return Finding(
                peer,
                False,
                f"it has not pulled from this robot within {self._seconds:g} s: "
                "it does not receive this robot by radio, its team file has another address than "
                f"{self._robot.shown_address}, port {port}, or a firewall here stops TCP and UDP",
            )
        pulls = f"it pulls from this robot, at port {port}"
        if isinstance(end, SyncEnded):
            return Finding(peer, True, pulls)
        return Finding(peer, False, f"{pulls}: {end.reason}")

    def _identity(self, peer: str) -> Iterator[Finding]:
        link = self._gossip.links(_now())[peer]
        if link.team_differs:
            text = (
                f"{peer} has another team file: only topics that both define alike are exchanged "
                "(the log of either node names the others)"
            )
            yield Finding(peer, False, text)
        if link.duplicate:
            text = (
                f"two processes run as {peer}, or as this robot: end one, or give each robot its "
                "own name"
            )
            yield Finding(peer, False, text)

    def _clock(self, peer: str) -> Iterator[Finding]:
        robot_id = self._team.robot(peer).robot_id
        stamps_s = [
            record.stamp_s
            for topic in self._team.topics_of(peer)
            if (record := self._gossip.database.newest(robot_id, topic.topic_id))
        ]
        ahead_s = max(stamps_s, default=0.0) - _now().unix_s
        if ahead_s > AHEAD_S:
            text = f"its clock is {ahead_s:.0f} s or more ahead of this one: set both by NTP or GPS"
            yield Finding(peer, False, text)

    def _signal(self, peer: str) -> Finding:
        reading = self._readings.get(peer)
        if reading is None:
            where = "it reports of others" if self._readings else "it reports nothing at all"
            return Finding(peer, False, f"the radio does not receive it ({where})")
        limit = threshold(self._team.trigger, reading.unit)
        text = f"the radio receives it at {reading.value:g} {reading.unit.value}"
        good = reading.value >= limit
        less = "a contact begins at" if good else "too weak: no contact begins below"
        return Finding(peer, good, f"{text}; {less} {limit:g}")


def _resolved(address: str, limit_s: float) -> tuple[tuple[str, ...], str]:
    """The addresses that a host stands for, or why there are none."""
    if is_number(address):
        return (address,), ""
    found = threading.Event()
    resolver = Resolver(found.set)
    if not resolver.hosts(address):
        found.wait(limit_s)
    why = resolver.failure(address) or f"the name server has not answered within {limit_s:g} s"
    return resolver.hosts(address), why


def _greets(host: str, port: int) -> bool:
    """Whether something at a place begins with the greeting that nodes send."""
    try:
        with socket.create_connection((host, port), timeout=GREET_S) as probe:
            return probe.recv(1) == b"\xff"
    except OSError:
        return False


def _now() -> Instant:
    return Instant(time.time(), time.monotonic())
