"""Asks a node's service (``mocha-link node --serve``) from another process.

Made to be used by any Python from 3.8 on that has `pyzmq`, e.g. that of a ROS installation: it
imports nothing else of others, and nothing of the node.
"""

from __future__ import annotations

from typing import Any

from mocha_link.errors import MochaLinkError
from mocha_link.service.asking import Asker

Place = tuple[str, int]  # epoch and sequence number


class ServiceError(MochaLinkError):
    """The node refused a request; it says why. `again`: the same may be taken later."""

    def __init__(self, message: str, *, again: bool = False) -> None:
        super().__init__(message)
        self.again = again


class ServiceUnreachableError(MochaLinkError):
    """No program answers at the endpoint, or one that is no node."""


class ServiceClient(Asker):
    """Asks one node. One thread may use it; a context manager.

    A node that does not answer may come back: every request tries anew.

    Args:
        endpoint: what the node got as ``--serve``.
        timeout_s: how long to wait for an answer, beyond what a request itself wants to wait.

    Raises:
        ServiceUnreachableError: the endpoint is none.
    """

    whom, option = "node", "--serve"

    def refused(self, message: str, *, again: bool) -> ServiceError:
        """See `Asker`."""
        return ServiceError(message, again=again)

    def unreachable(self, message: str) -> ServiceUnreachableError:
        """See `Asker`."""
        return ServiceUnreachableError(message)

    def publish(
        self,
        topic: str,
        data: bytes,
        *,
        now: bool = False,
        ros: int | None = None,
        key: str | None = None,
    ) -> str:
        """Publish in the robot's name; returns the header in hex digits.

        `ros` says how the data are serialized, if not as the robot's other ROS messages; a request
        that is repeated with the same `key` publishes once.
        """
        fields: dict[str, Any] = {"topic": topic, "now": now, "ros": ros, "key": key}
        return str(self.request("publish", data, **fields)[0].get("header"))

    def latest(
        self, robot: str, topic: str, *, ros: int | None = None
    ) -> tuple[dict[str, Any], bytes] | None:
        """The newest message of a topic: what is said about it, and its data."""
        fields, parts = self.request("latest", robot=robot, topic=topic, ros=ros)
        return (fields["message"], parts[0]) if fields.get("message") and parts else None

    def messages(self, robot: str | None = None) -> list[dict[str, Any]]:
        """What is said about the newest message of every topic, of all robots or of one."""
        found: list[dict[str, Any]] = self.request("list", robot=robot)[0].get("messages", [])
        return found

    def since(
        self,
        place: Place | None = None,
        *,
        limit: int = 100,
        wait_s: float = 0.0,
        own: bool = False,
        ros: int | None = None,
    ) -> tuple[Place, list[tuple[dict[str, Any], bytes]]]:
        """What was stored after a place in the sequence; waits up to `wait_s` for something.

        Returns the place to ask from next time, and the messages. A caller that remembers the place
        misses nothing. After the node was restarted it begins anew, with everything that it has.
        """
        epoch, sequence = place or (None, 0)
        fields, parts = self.request(
            "since",
            epoch=epoch,
            sequence=sequence,
            limit=limit,
            wait_s=wait_s,
            own=own,
            ros=ros,
        )
        try:
            messages = list(zip(fields["messages"], parts))  # noqa: B905 - Python 3.8
            return (fields["epoch"], fields["sequence"]), messages
        except (LookupError, TypeError):
            raise self.another() from None

    def team(self) -> dict[str, Any]:
        """Which robot this is, and what there is in the team: robots, topics, types."""
        return self.request("team")[0]

    def request(
        self, name: str, data: bytes | None = None, **fields: object
    ) -> tuple[dict[str, Any], list[bytes]]:
        """Ask; returns the answer and the data frames behind it.

        Raises:
            ServiceError: the node refused.
            ServiceUnreachableError: no answer in time.
        """
        wait = fields.get("wait_s")
        wait_s = wait if isinstance(wait, (int, float)) else 0.0
        return self.ask({"request": name, **fields}, data, wait_s=wait_s)


def split(about: dict[str, Any], data: bytes) -> list[bytes]:
    """The messages in the data of one: several if its topic says `aggregate`."""
    if "parts" not in about:
        return [data]
    parts = []
    start = 0
    for size in about["parts"]:
        parts.append(data[start : start + size])
        start += size
    return parts
