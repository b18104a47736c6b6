"""Whose message it is, however many robots handed it on: signatures, and what to accept.

A signature covers the ids and names of robot and topic, the full time, dtype, priority and the LZ4
frame. What is accepted from whom is the team's `trust` (docs/security.md).
"""

from __future__ import annotations

from collections.abc import Callable

from mocha_link.store import wire
from mocha_link.store.wire import Body, Header, PayloadError, Trailer
from mocha_link.team.keys import SecretKey, public_key
from mocha_link.team.team import Robot, Team, Topic, Trust

_PURPOSE = b"mocha-link message 1\0"


class SignatureError(PayloadError):
    """A message whose signature is missing or wrong, or that this peer may not hand on."""


class Signer:
    """Signs the messages of one robot: ``payload.pack(..., sign=signer.of(topic))``."""

    def __init__(self, secret: SecretKey, robot: Robot) -> None:
        self._secret = secret
        self._robot = robot

    def of(self, topic: Topic) -> Callable[[bytes], bytes]:
        """What signs a message of a topic."""
        about = _about(self._robot, topic)
        return lambda statement: self._secret.sign(about + statement)


class Verifier:
    """Decides what is accepted from whom, as the team's `trust` says.

    Raises:
        KeyMismatchError: a key in the team file is none.
        KeysUnavailableError: the team has keys, and PyNaCl is missing.
    """

    def __init__(self, team: Team) -> None:
        self._team = team
        # by robot; None: it signs nothing
        self._keys = {name: public_key(robot) for name, robot in team.robots.items()}

    def verify(
        self, header: Header, body: Body, trailer: Trailer | None, *, handed_by: str
    ) -> None:
        """Accept a message that a peer handed us; `trailer` is what `payload.check` returned.

        Raises:
            SignatureError: not accepted; the message says why.
        """
        known = self._team.by_ids(header.robot_id, header.topic_id)
        if known is None:
            raise SignatureError(f"{header} is not of this team")
        robot, topic = known
        if trailer and header != Header.at(header.robot_id, header.topic_id, trailer.stamp_ms):
            raise SignatureError(f"{header} carries the time of another message")
        key = self._keys[robot.name]
        if key is None:
            if self._team.trust is Trust.SIGNED and handed_by != robot.name:
                raise SignatureError(
                    f"{robot.name} has no key: its messages are taken from itself only, "
                    f"not from {handed_by}"
                )
        elif trailer is None or trailer.signature is None:
            if self._team.trust is Trust.SIGNED:
                raise SignatureError(f"not signed by {robot.name}, handed on by {handed_by}")
        else:
            view = memoryview(body)
            frame = view[wire.PREFIX : trailer.at]
            statement = wire.statement(view[: wire.PREFIX], trailer.stamp_ms, frame)
            if not key.proves(trailer.signature, _about(robot, topic) + statement):
                raise SignatureError(
                    f"the signature is not of {robot.name}, handed on by {handed_by}"
                )


def _about(robot: Robot, topic: Topic) -> bytes:
    names = f"{robot.name}\0{topic.name}\0".encode()
    return _PURPOSE + bytes((robot.robot_id, topic.topic_id)) + names
