"""MAVLink frames of companions and ground stations, from names and fields."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

_CLASSES: Final = {message.msgname: message for message in mavlink.mavlink_map.values()}


class Encoder:
    """Packs the messages of one sender.

    Args:
        system_id: Its system id.
        component_id: Its component id.
    """

    def __init__(self, system_id: int, component_id: int) -> None:
        self.system_id = system_id
        self.component_id = component_id
        self._sender = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)

    def frame(self, name: str, fields: Mapping[str, Any]) -> bytes:
        """One message; fields that are not given are 0, texts may be `str`."""
        kind = _CLASSES[name]
        values = {
            field: _encoded(fields.get(field, 0), kind.fieldtypes[kind.fieldnames.index(field)])
            for field in kind.fieldnames
        }
        return bytes(kind(**values).pack(self._sender))


def _encoded(value: Any, kind: str) -> Any:
    if kind == "char":
        return value.encode() if isinstance(value, str) else value or b""
    if kind in {"float", "double"}:
        return float(value)
    return int(value)
