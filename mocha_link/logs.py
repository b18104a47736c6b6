"""The logs of nodes: one logger each, below ``mocha_link``.

Records have `robot` and `peer` (or None): a program with several nodes can tell their lines apart,
and a formatter can show both.
"""

from __future__ import annotations

import logging
from collections.abc import MutableMapping
from typing import Any

NODE_LOGS = "mocha_link.node"
"""What the names of all nodes' loggers begin with."""

Log = logging.Logger | logging.LoggerAdapter[Any]
"""What a part of a node writes to."""


class NodeLog(logging.LoggerAdapter[logging.Logger]):
    """The logger ``mocha_link.node.<robot>``; a dot in the robot's name becomes ``_``.

    Args:
        robot: whose node it is.
        peer: the robot at the other end of a link; None: the line is about no link.
    """

    def __init__(self, robot: str, peer: str | None = None) -> None:
        self._about = {"robot": robot, "peer": peer}  # of every record
        super().__init__(logging.getLogger(f"{NODE_LOGS}.{robot.replace('.', '_')}"))

    def of(self, peer: str) -> NodeLog:
        """The same for a line about the link to a peer."""
        return NodeLog(self._about["robot"] or "", peer)

    def process(
        self, msg: Any, kwargs: MutableMapping[str, Any]
    ) -> tuple[Any, MutableMapping[str, Any]]:
        """Add `robot` and `peer` to a record."""
        kwargs["extra"] = {**self._about, **(kwargs.get("extra") or {})}
        return msg, kwargs
