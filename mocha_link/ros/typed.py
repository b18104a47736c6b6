"""What messages mean: JSON values, ROS messages, or bytes, by the type in the team file.

``json/...`` types are UTF-8 JSON. Standard ROS types and those in the team's `definitions` are ROS
messages, serialized for the ROS version of the publishing robot (`Robot.ros`); they need the extra
``ros``. All others are bytes.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping
from typing import Any

from mocha_link.errors import MissingExtraError, MochaLinkError
from mocha_link.store import Message
from mocha_link.team import Ros, Team

JSON_PACKAGE = "json/"

LOG = logging.getLogger("mocha_link")


class TypedError(MochaLinkError):
    """Bytes that do not match their type, or a value that does not fit the type."""


class Types:
    """Converts payloads to values and back, by the names of types. Any thread may use it.

    Args:
        definitions: texts of ``.msg`` files by ``pkg/Type``, as in a team file.

    Raises:
        RosError: one of the definitions cannot be used.
    """

    def __init__(self, definitions: Mapping[str, str]) -> None:
        self._codec = _codec(definitions)  # a `RosCodec`; None without the extra

    @property
    def has_ros(self) -> bool:
        """Whether ROS messages can be converted here: the extra ``ros`` is installed."""
        return self._codec is not None

    def decode(self, kind: str, data: bytes, ros: Ros) -> Any:
        """Decode a payload.

        Args:
            kind: the name of the type, e.g. ``geometry_msgs/Pose``.
            data: the payload.
            ros: the ROS version (1 or 2) of the serialization.

        Returns:
            A JSON value, a ROS message object, or the bytes if the type is unknown.

        Raises:
            TypedError: the payload does not match the type.
        """
        if kind.startswith(JSON_PACKAGE):
            return _parsed(data)
        codec = self._codec_for(kind, ros)
        return _guarded(codec.decode, kind, data, ros) if codec else data

    def plain(self, kind: str, data: bytes, ros: Ros) -> Any:
        """Decode a payload to values that `json.dumps` accepts; bytes of unknown types stay bytes.

        Args:
            kind: the name of the type.
            data: the payload.
            ros: the ROS version of the serialization.

        Raises:
            TypedError: the payload does not match the type.
        """
        value = self.decode(kind, data, ros)
        codec = None if kind.startswith(JSON_PACKAGE) else self._codec_for(kind, ros)
        return _guarded(codec.to_json, kind, value) if codec else value

    def encode(self, kind: str, value: Any, ros: Ros) -> bytes:
        """Encode a value.

        Args:
            kind: the name of the type.
            value: a JSON value; for a ROS type a message object or plain values; else bytes.
            ros: the ROS version of the serialization.

        Returns:
            The payload.

        Raises:
            TypedError: the value does not fit the type.
        """
        if kind.startswith(JSON_PACKAGE):
            try:
                return json.dumps(value, allow_nan=False, separators=(",", ":")).encode()
            except (TypeError, ValueError, RecursionError) as error:
                raise TypedError(f"not a JSON value: {error}") from None
        codec = self._codec_for(kind, ros)
        if codec:
            data: bytes = _guarded(codec.encode, kind, value, ros)
            return data
        if not isinstance(value, bytes | bytearray | memoryview):
            hint = "" if self.has_ros else "; ROS messages need the extra 'ros' here"
            raise TypedError(f"only bytes can be sent as {kind}{hint}")
        return bytes(value)

    def converted(self, kind: str, data: bytes, from_ros: Ros, to_ros: Ros) -> bytes:
        """Check a ROS message and convert it to the other ROS version.

        Args:
            kind: the name of the type.
            data: the payload.
            from_ros: its ROS version.
            to_ros: the ROS version of the result.

        Returns:
            The payload in the other serialization; payloads of unknown types are returned
            unchanged.

        Raises:
            TypedError: the payload does not match the type, or cannot be converted here.
        """
        if kind.startswith(JSON_PACKAGE):
            _parsed(data)
            return data
        codec = self._codec_for(kind, from_ros)
        if codec is None:
            if self._codec is None and from_ros != to_ros:
                raise TypedError(f"from ROS {from_ros} to {to_ros}: that needs the extra 'ros'")
            return data
        value = _guarded(codec.decode, kind, data, from_ros)
        if from_ros == to_ros == 1:
            return data
        # CDR is written anew: another byte order or padding at its end is not read by all.
        changed: bytes = _guarded(codec.encode, kind, value, to_ros)
        return changed

    def about(self, kind: str) -> dict[str, Any]:
        """The facts about a type that bridges need.

        Args:
            kind: the name of the type.

        Returns:
            `ros`, the ROS versions that have the type, and for ROS 1 `md5` and `text`; empty for an
            unknown type.
        """
        known = [ros for ros in (1, 2) if self._codec_for(kind, ros)]
        if self._codec is None or 1 not in known:
            return {"ros": known} if known else {}
        text, md5 = self._codec.definition(kind)
        return {"ros": known, "md5": md5, "text": text}

    def _codec_for(self, kind: str, ros: Ros) -> Any:
        return self._codec if self._codec and self._codec.knows(kind, ros) else None


class Typed:
    """Converts the messages of a team.

    Args:
        team: has the types of topics and the definitions.

    Attributes:
        types: converts payloads by the names of types.

    Raises:
        RosError: a definition in the team file cannot be used.
    """

    def __init__(self, team: Team) -> None:
        self._team = team
        self.types = Types(team.definitions)

    def decode(self, message: Message) -> Any:
        """Decode a message.

        Args:
            message: a message of the team.

        Returns:
            A JSON value, a ROS message object, or bytes; a list of these for a topic with
            `aggregate`.

        Raises:
            TypedError: the payload does not match the type. The message itself can still be
                carried.
        """
        return self._all(message, self.types.decode)

    def plain(self, message: Message) -> Any:
        """Decode a message to values that `json.dumps` accepts; bytes of unknown types stay bytes.

        Args:
            message: a message of the team.

        Raises:
            TypedError: the payload does not match the type.
        """
        return self._all(message, self.types.plain)

    def encode(self, robot: str, topic: str, value: Any) -> bytes:
        """Encode the payload of a message.

        Args:
            robot: the name of the robot that publishes it.
            topic: the name of the topic.
            value: a JSON value; for a ROS type a message object or plain values; else bytes.

        Returns:
            The payload.

        Raises:
            UnknownRobotError: the team has no such robot.
            UnknownTopicError: the robot has no such topic.
            TypedError: the value does not fit the topic's type.
        """
        known = self._team.topic(robot, topic)
        try:
            return self.types.encode(known.type, value, self._team.robot(robot).ros)
        except TypedError as error:
            raise TypedError(f"{robot} {topic}: {error}") from None

    def _all(self, message: Message, work: Callable[[str, bytes, Ros], Any]) -> Any:
        topic = self._team.topic(message.robot, message.topic)
        ros = self._team.robot(message.robot).ros
        if topic.aggregate and message.data and not message.parts:
            raise TypedError(f"{message.robot} {message.topic}: not a batch of messages")
        try:
            if topic.aggregate:
                return [work(topic.type, part, ros) for part in message.parts]
            return work(topic.type, message.data, ros)
        except TypedError as error:
            raise TypedError(f"{message.robot} {message.topic}: {error}") from None


def _codec(definitions: Mapping[str, str]) -> Any:
    try:
        from mocha_link.ros.ros import RosCodec  # noqa: PLC0415 - an extra that may be missing
    except MissingExtraError as error:
        LOG.warning("what is not JSON is left as bytes: %s", error)
        return None
    return RosCodec(definitions)


def _guarded(work: Any, *arguments: Any) -> Any:
    try:
        return work(*arguments)
    except MochaLinkError as error:
        raise TypedError(str(error)) from None


def _parsed(data: bytes) -> Any:
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise TypedError(f"not JSON: {error}") from None
