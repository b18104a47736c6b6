"""Scripted conversations with a PX4: recorded on a real one, checked on the simulated one."""

from sitl.conformance.conversation import (
    Conversation,
    Outcome,
    asked_version,
    conversations,
    converse,
)
from sitl.conformance.differences import table_of_facts, table_of_steps
from sitl.conformance.session import Line, Link, LocalLine, SilentVehicleError, UdpLine

__all__ = [
    "Conversation",
    "Line",
    "Link",
    "LocalLine",
    "Outcome",
    "SilentVehicleError",
    "UdpLine",
    "asked_version",
    "conversations",
    "converse",
    "table_of_facts",
    "table_of_steps",
]
