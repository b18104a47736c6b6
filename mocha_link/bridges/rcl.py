"""The ROS 2 side of a bridge: what every way to ROS 2 shares, and the way through rclpy.

Messages stay bytes; only text is unpacked, in which JSON travels.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable, Collection
from typing import Any

MIN_DEPTH = 10  # messages that wait for a subscription
_LITTLE_ENDIAN = b"\x00\x01"


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

    def subscribe(self, topic: str, kind: str, history: int, hand: Callable[[bytes], None]) -> None:
        """See `bridge.Middleware`."""
        reliable = topic not in self._best_effort
        depth = max(history, MIN_DEPTH)
        qos = self._qos(depth, reliable=reliable, lasting=False)
        self._node.create_subscription(_class(kind), topic, hand, qos, raw=True)
        if not self._spinning:
            self._spinning = True
            self._thread.start()

    def publish(self, topic: str, kind: str, history: int, data: bytes) -> None:
        """See `bridge.Middleware`. The newest stay for subscribers that come later and ask so."""
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
