"""The ROS 1 side of a bridge: rospy, with messages as the bytes that they are.

Nothing is decoded here, so the packages of the message types need not be installed: what rospy
must know of a type comes from the node, which has made the bytes.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable
from typing import Any

BUFFER_BYTES = 16 * 1024 * 1024  # rospy falls behind with large messages in a smaller one
ROSCORE_S = 5.0  # between looks at whether the roscore is still the same
FIRST_S = 0.2  # until there is one

LOG = logging.getLogger("mocha_link")

_TEXT = {"md5": "992ce8a1687cec8c8bd883ec73ca41d1", "text": "string data\n"}
"""Of std_msgs/String, which carries JSON also for a node that knows no ROS types."""


class Ros1:
    """Publishes and subscribes as a ROS 1 node. Needs rospy, and waits for a roscore.

    Args:
        name: of the ROS node.
        types: by type name what the node says of it: ``md5`` and ``text``.
    """

    ros = 1

    def __init__(self, name: str, types: dict[str, dict[str, Any]]) -> None:
        import rospy  # noqa: PLC0415 - of a ROS installation

        self._rospy = rospy  # module, of a ROS 1 installation
        self.types = {**types, "std_msgs/String": _TEXT}
        self._classes: dict[str, Any] = {}  # message classes, by type
        self._publishers: dict[str, Any] = {}  # by topic
        self._subscribers: list[Any] = []  # kept from the garbage collector
        self._odd: set[str] = set()  # topics of another type, told once
        rospy.init_node(name, disable_signals=True)
        LOG.disabled = False  # rospy takes over all logging
        handler = logging.StreamHandler()
        handler.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
        LOG.addHandler(handler)
        LOG.propagate = False

    def subscribe(self, topic: str, kind: str, history: int, hand: Callable[[bytes], None]) -> None:
        """See `bridge.Middleware`. Publishers of another type are told once, and not heard."""
        md5 = self.types.get(kind, {}).get("md5", "*")

        def heard(message: Any) -> None:
            header = message._connection_header  # noqa: SLF001 - rospy's way
            said, its_md5 = header.get("type", kind), header.get("md5sum", "*")
            if said == kind and (its_md5 == md5 or "*" in (its_md5, md5)):
                hand(message._buff)  # noqa: SLF001 - the bytes; AnyMsg has nothing else
            elif topic not in self._odd:
                self._odd.add(topic)
                theirs, ours = f"{said} ({its_md5})", f"{kind} ({md5})"
                LOG.warning("%s is published as %s; the team says %s", topic, theirs, ours)

        subscriber = self._rospy.Subscriber(
            topic, self._rospy.AnyMsg, heard, queue_size=max(100, history), buff_size=BUFFER_BYTES
        )
        self._subscribers.append(subscriber)

    def publish(self, topic: str, kind: str, history: int, data: bytes) -> None:
        """See `bridge.Middleware`. The newest message stays for subscribers that come later."""
        made = self._class(kind)
        if topic not in self._publishers:
            self._publishers[topic] = self._rospy.Publisher(
                topic, made, latch=True, queue_size=max(100, history)
            )
        message = made()
        message._buff = data  # noqa: SLF001
        self._publishers[topic].publish(message)

    def text(self, data: bytes) -> bytes:
        """See `bridge.Middleware`."""
        return struct.pack("<I", len(data)) + data

    def from_text(self, data: bytes) -> bytes:
        """See `bridge.Middleware`."""
        if len(data) < 4 or struct.unpack_from("<I", data)[0] != len(data) - 4:
            raise ValueError("not a std_msgs/String")
        return data[4:]

    def close(self) -> None:
        """See `bridge.Middleware`."""
        self._rospy.signal_shutdown("the bridge ends")

    def watch(self, wait: Callable[[float], bool]) -> str | None:
        """See `bridge.Middleware`. A roscore does not know the ROS nodes that are older than it."""
        first = self._run_id()
        while not wait(ROSCORE_S if first else FIRST_S):
            run = self._run_id()
            if run is not None and first is not None and run != first:
                return "the roscore was restarted, and does not know this process; start it again"
            first = first or run
        return None

    def _run_id(self) -> str | None:
        import rosgraph  # noqa: PLC0415 - of a ROS installation

        try:
            return str(rosgraph.Master("/mocha_bridge").getParam("/run_id"))
        except Exception:  # noqa: BLE001 - whatever it is, there is no roscore now
            return None

    def _class(self, kind: str) -> Any:
        """A class of messages that are their bytes, with the names that rospy tells others."""
        if kind not in self._classes:
            about = self.types[kind]
            self._classes[kind] = type(
                "Bytes",
                (self._rospy.AnyMsg,),
                {
                    "__slots__": ["_buff"],
                    "_type": kind,
                    "_md5sum": about["md5"],
                    "_full_text": about["text"],
                    "_has_header": False,
                },
            )
        return self._classes[kind]
