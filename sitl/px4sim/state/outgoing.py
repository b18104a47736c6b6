"""A MAVLink message to be sent, before it is bytes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Outgoing:
    """Name and fields of one message, as in the MAVLink definitions."""

    name: str
    fields: Mapping[str, Any]
