"""What messages mean: JSON values, ROS messages, or bytes, by the type in the team file.

``json/...`` types are UTF-8 JSON. Standard ROS types and those in the team's `definitions` are ROS
messages, serialized as the robot that publishes them says (`Robot.ros`); they need the extra
``ros``. All others are bytes.
"""

from __future__ import annotations

import json
import logging
from typing import TYPE_CHECKING, Any

from mocha_link.errors import MochaLinkError

if TYPE_CHECKING:
    from mocha_link.node import Message
    from mocha_link.ros import RosCodec
    from mocha_link.team import Robot, Team, Topic

JSON_PACKAGE = "json/"

LOG = logging.getLogger("mocha_link")


class TypedError(MochaLinkError):
    """Data that are not what their topic's type says, or a value that does not fit it."""


class Typed:
    """Turns the data of a team's messages into values, and back. Any thread may use it.

    Raises:
        RosError: the team brings along a definition that cannot be used.
    """

    def __init__(self, team: Team) -> None:
        self._team = team
        self._codec = _codec(team)

    def decode(self, message: Message) -> Any:
        """What a message says: a JSON value, a ROS message object, or its bytes.

        Raises TypedError; the message itself is still good to carry.
        """
        robot, topic = self._known(message.robot, message.topic)
        if topic.type.startswith(JSON_PACKAGE):
            return _parsed(message.data, f"{robot.name} {topic.name}")
        if self._codec and self._codec.knows(topic.type, robot.ros):
            try:
                return self._codec.decode(topic.type, message.data, robot.ros)
            except MochaLinkError as error:
                raise TypedError(f"{robot.name} {topic.name}: {error}") from None
        return message.data

    def plain(self, message: Message) -> Any:
        """As `decode`, but ROS messages as values that `json.dumps` takes; bytes stay bytes."""
        _, topic = self._known(message.robot, message.topic)
        value = self.decode(message)
        if self._codec is None or value is message.data or topic.type.startswith(JSON_PACKAGE):
            return value
        return self._codec.to_json(topic.type, value)

    def encode(self, robot: str, topic: str, value: Any) -> bytes:
        """The data of a message of a robot; ROS messages as objects or as plain values.

        Raises:
            UnknownRobotError: the team has no such robot.
            UnknownTopicError: the robot has no such topic.
            TypedError: the value does not fit the topic's type.
        """
        sender, known = self._known(robot, topic)
        if known.type.startswith(JSON_PACKAGE):
            try:
                return json.dumps(value, allow_nan=False, separators=(",", ":")).encode()
            except (TypeError, ValueError, RecursionError) as error:
                raise TypedError(f"{robot} {topic}: not a JSON value: {error}") from None
        if self._codec and self._codec.knows(known.type, sender.ros):
            try:
                return self._codec.encode(known.type, value, sender.ros)
            except MochaLinkError as error:
                raise TypedError(f"{robot} {topic}: {error}") from None
        if not isinstance(value, bytes | bytearray | memoryview):
            raise TypedError(f"{robot} {topic} is {known.type}: only bytes can be sent as that")
        return bytes(value)

    def _known(self, robot: str, topic: str) -> tuple[Robot, Topic]:
        return self._team.robot(robot), self._team.topic(robot, topic)


def _codec(team: Team) -> RosCodec | None:
    try:
        from mocha_link.ros import RosCodec  # noqa: PLC0415 - an extra that may be missing
    except ModuleNotFoundError as error:
        LOG.warning("what is not JSON is left as bytes: %s", error)
        return None
    return RosCodec(team.definitions)


def _parsed(data: bytes, what: str) -> Any:
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise TypedError(f"{what}: not JSON: {error}") from None
