"""The team file of the two nodes, and of those whose messages the first one relays."""

from pathlib import Path

from benchmarks.link.offer import TOPICS_PER_ROBOT, Offer, place
from benchmarks.link.ways import ADDRESSES
from mocha_link import Document, Team

SOURCE, SINK = "a", "b"
PORT = 7100  # where each of the two serves the other
_RELAY_PORT = 7300


def team_of(offer: Offer, addresses: tuple[str, str] = ADDRESSES) -> Team:
    """Node `a` serves `b` and knows further robots on its own machine, if the offer needs them."""
    others = [robot_name(robot) for robot in range(1, place(offer.count - 1)[0] + 1)]
    robots = {
        SOURCE: (addresses[0], PORT, [SINK, *others]),
        SINK: (addresses[1], PORT, [SOURCE]),
    }
    for number, name in enumerate(others):
        robots[name] = ("127.0.0.1", _RELAY_PORT + number, [SOURCE])
    lines = ["robots:"]
    lines += [
        f"  {name}: {{kind: k, address: {address}, listen: {address}, base_port: {port}, "
        f"clients: [{', '.join(c)}]}}"
        for name, (address, port, c) in robots.items()
    ]
    lines += ["kinds:", "  k:", "    topics:"]
    topics = min(offer.count, TOPICS_PER_ROBOT)
    lines += [f"      - {{name: {topic_name(n)}, type: raw/Bytes}}" for n in range(topics)]
    text = "\n".join([*lines, "trigger: {interval_s: 2}"])
    return Team.from_document(Document.from_text(text, Path("benchmark")))


def robot_name(robot: int) -> str:
    """The robots by number, named so that their ids are 0, (1 for the sink), 2, 3, ..."""
    return f"f{robot:03}" if robot else SOURCE


def topic_name(topic: int) -> str:
    return f"/t{topic}"
