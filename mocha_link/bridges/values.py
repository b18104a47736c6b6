"""Messages as JSON for programs that do not want bytes: requests on their way in, answers out."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Any

from mocha_link.ros.typed import TypedError, Types
from mocha_link.service.requests import RequestError
from mocha_link.service.service_client import split


class ValueTranslator:
    """Translates for the programs of one robot.

    Args:
        team: what the node says of the team.

    Raises:
        RosError: the team brings along a definition that cannot be used.
    """

    def __init__(self, team: dict[str, Any]) -> None:
        self._types = Types(team["definitions"])
        self._robots = team["robots"]  # as the node describes them
        self.robot: str = team["robot"]  # whose programs these are
        # types of its own topics
        self._kinds = {topic["name"]: topic["type"] for topic in self._robots[self.robot]["topics"]}

    def request(
        self, values: dict[str, Any], data: Sequence[bytes]
    ) -> tuple[dict[str, Any], Sequence[bytes], bool]:
        """A request as the node wants it, and whether the answer is wanted as JSON.

        ``value`` of ``publish`` becomes its data; ``json`` is only ours. Raises RequestError.
        """
        values = dict(values)
        wanted = values.pop("json", False)
        if "value" in values and values.get("request") == "publish":
            topic, value = values.get("topic"), values.pop("value")
            kind = self._kinds.get(topic) if isinstance(topic, str) else None
            if kind is None:
                raise RequestError(f"{self.robot} has no topic {str(topic)[:80]!r}")
            if data:
                raise RequestError("publish has a value or a frame of data, not both")
            try:
                data = [self._types.encode(kind, _from_base64(value), self._ros(self.robot))]
            except TypedError as error:
                raise RequestError(f"{topic}: {error}") from None
        return values, data, wanted is True

    def answer(self, values: dict[str, Any], data: Sequence[bytes]) -> dict[str, Any]:
        """An answer of the node with the messages as values in place of data."""
        messages = values.get("messages", [values.get("message")])
        for about, body in zip(messages, data, strict=False):
            if isinstance(about, dict):
                about.update(self.value(about, body))
        return values

    def value(self, about: dict[str, Any], data: bytes) -> dict[str, Any]:
        """``value`` of a message, ``values`` if it is several in one, or ``error``."""
        ros = self._ros(about["robot"])
        try:
            values = [
                _as_base64(self._types.plain(about["type"], part, ros))
                for part in split(about, data)
            ]
            json.dumps(values, allow_nan=False)
        except (TypedError, ValueError) as error:
            return {"error": str(error)}
        return {"values": values} if "parts" in about else {"value": values[0]}

    def _ros(self, robot: str) -> Any:
        return self._robots.get(robot, {}).get("ros", 1)


def _as_base64(value: Any) -> Any:
    return {"base64": base64.b64encode(value).decode()} if isinstance(value, bytes) else value


def _from_base64(value: Any) -> Any:
    """Bytes that were sent as ``{"base64": text}``; any other value as it is."""
    if not isinstance(value, dict) or set(value) != {"base64"}:
        return value
    try:
        return base64.b64decode(value["base64"], validate=True)
    except (TypeError, ValueError):
        raise TypedError("not Base64 text") from None
