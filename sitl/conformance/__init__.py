"""Scripted MAVLink conversations: recorded with a real PX4, checked on the simulated one."""

from sitl.conformance.conversation import (
    Conversation,
    Outcome,
    conversations,
    converse,
    reported_version,
)
from sitl.conformance.differences import table_of_facts, table_of_steps
from sitl.conformance.session import Line, LinkKind, LocalLine, SilentVehicleError, UdpLine

__all__ = [
    "Conversation",
    "Line",
    "LinkKind",
    "LocalLine",
    "Outcome",
    "SilentVehicleError",
    "UdpLine",
    "conversations",
    "converse",
    "reported_version",
    "table_of_facts",
    "table_of_steps",
]
