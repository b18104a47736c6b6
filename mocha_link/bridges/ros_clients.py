"""The ways of a bridge to ROS through the Python client libraries of an installation: rospy, rclpy.

Messages stay the bytes that they are; only text is unpacked, in which JSON travels. For ROS 1 the
packages of the message types need not be installed: what rospy must know of a type comes from the
node, which has made the bytes.
"""

from __future__ import annotations

import logging
import struct
import threading
from collections.abc import Callable, Collection
from typing import Any

BUFFER_BYTES = 16 * 1024 * 1024  # rospy falls behind with large messages in a smaller one
ROSCORE_S = 5.0  # between checks that the roscore is still the same
FIRST_S = 0.2  # until there is one
MIN_DEPTH = 10  # messages that wait for a subscription of ROS 2
_LITTLE_ENDIAN = b"\x00\x01"

LOG = logging.getLogger("mocha_link")

_TEXT = {"md5": "992ce8a1687cec8c8bd883ec73ca41d1", "text": "string data\n"}
"""Of std_msgs/String, which carries JSON also for a node that knows no ROS types."""


class Ros1:
    """Publishes and subscribes as a ROS 1 node. Needs rospy, and waits for a roscore.

    Args:
        name: of the ROS node.
        types: by type name the fields of the node: ``md5`` and ``text``.
    """

    ros = 1

    def __init__(self, name: str, types: dict[str, dict[str, Any]]) -> None:
        import rospy  # noqa: PLC0415 - of a ROS installation

        self._rospy = rospy  # module, of a ROS 1 installation
        self.types = {**types, "std_msgs/String": _TEXT}
        self._classes: dict[str, Any] = {}  # message classes, by type
        self._publishers: dict[str, Any] = {}  # by topic
        self._subscribers: list[Any] = []  # kept from the garbage collector
        self._odd: set[str] = set()  # topics of another type, logged once
        rospy.init_node(name, disable_signals=True)
        LOG.disabled = False  # rospy takes over all logging
        handler = logging.StreamHandler()
        handler.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
        LOG.addHandler(handler)
        LOG.propagate = False

    def subscribe(self, topic: str, kind: str, history: int, take: Callable[[bytes], None]) -> None:
        """See `bridge.Middleware`. Publishers of another type are logged once and ignored."""
        md5 = self.types.get(kind, {}).get("md5", "*")

        def received(message: Any) -> None:
            header = message._connection_header  # noqa: SLF001 - rospy's way
            published_type, its_md5 = header.get("type", kind), header.get("md5sum", "*")
            if published_type == kind and (its_md5 == md5 or "*" in (its_md5, md5)):
                take(message._buff)  # noqa: SLF001 - the bytes; AnyMsg has nothing else
            elif topic not in self._odd:
                self._odd.add(topic)
                theirs, ours = f"{published_type} ({its_md5})", f"{kind} ({md5})"
                LOG.warning("%s is published as %s; the team file has %s", topic, theirs, ours)

        subscriber = self._rospy.Subscriber(
            topic,
            self._rospy.AnyMsg,
            received,
            queue_size=max(100, history),
            buff_size=BUFFER_BYTES,
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
        """A class of messages that are their bytes, with the names that rospy announces."""
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


class Cdr:
    """A middleware whose messages are CDR."""

    ros = 2

    def text(self, data: bytes) -> bytes:
        """See `bridge.Middleware`."""
        return _LITTLE_ENDIAN + b"\0\0" + struct.pack("<I", len(data) + 1) + data + b"\0"

    def from_text(self, data: bytes) -> bytes:
        """See `bridge.Middleware`."""
        order = "<" if data[:2] == _LITTLE_ENDIAN else ">"
        if len(data) < 9 or data[0] or data[1] > 1:
            raise ValueError("not a std_msgs/String")
        end = 8 + struct.unpack_from(f"{order}I", data, 4)[0]
        if not 9 <= end <= len(data) <= end + 3 or data[end - 1]:
            raise ValueError("not a std_msgs/String")
        return data[8 : end - 1]

    def watch(self, wait: Callable[[float], bool]) -> str | None:
        """See `bridge.Middleware`: DDS needs no server that could be another one later."""
        del wait
        return None


class Rcl(Cdr):
    """Publishes and subscribes as a ROS 2 node. Needs rclpy and the packages of the messages.

    Args:
        name: of the ROS node.
        best_effort: topics that are subscribed that way, because their publishers do no better.
    """

    def __init__(self, name: str, *, best_effort: Collection[str] = ()) -> None:
        import rclpy  # noqa: PLC0415 - of a ROS installation
        from rclpy.executors import ExternalShutdownException  # noqa: PLC0415
        from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415

        self._rclpy = rclpy  # module, of a ROS 2 installation
        self._ended = ExternalShutdownException  # raised when a signal ends rclpy
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(name)
        self._best_effort = best_effort
        self._publishers: dict[str, Any] = {}  # by topic
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)
        self._spinning = False  # a thread runs callbacks

    def subscribe(self, topic: str, kind: str, history: int, take: Callable[[bytes], None]) -> None:
        """See `bridge.Middleware`."""
        reliable = topic not in self._best_effort
        depth = max(history, MIN_DEPTH)
        qos = self._qos(depth, reliable=reliable, lasting=False)
        self._node.create_subscription(_class(kind), topic, take, qos, raw=True)
        if not self._spinning:
            self._spinning = True
            self._thread.start()

    def publish(self, topic: str, kind: str, history: int, data: bytes) -> None:
        """See `bridge.Middleware`. Late subscribers that request it receive the newest messages."""
        if topic not in self._publishers:
            qos = self._qos(history, reliable=True, lasting=True)
            self._publishers[topic] = self._node.create_publisher(_class(kind), topic, qos)
        self._publishers[topic].publish(data)

    def close(self) -> None:
        """See `bridge.Middleware`."""
        self._rclpy.shutdown()
        if self._spinning:
            self._thread.join()

    def _spin(self) -> None:
        try:
            self._rclpy.spin(self._node)
        except self._ended:
            return

    @staticmethod
    def _qos(depth: int, *, reliable: bool, lasting: bool) -> Any:
        from rclpy import qos  # noqa: PLC0415 - of a ROS installation

        durability = qos.DurabilityPolicy
        reliability = qos.ReliabilityPolicy
        return qos.QoSProfile(
            depth=depth,
            reliability=reliability.RELIABLE if reliable else reliability.BEST_EFFORT,
            durability=durability.TRANSIENT_LOCAL if lasting else durability.VOLATILE,
        )


def _class(kind: str) -> Any:
    from rosidl_runtime_py.utilities import get_message  # noqa: PLC0415 - of a ROS installation

    package, _, name = kind.partition("/")
    return get_message(f"{package}/msg/{name}")
