"""Topics and services among ROS 2 programs, as plain values: CycloneDDS and the ROS types.

Services are those of rmw_cyclonedds: a request has its client and a number. The reply, which
all clients receive, has both again. Other middlewares have services of their own.
"""

import contextlib
import logging
import time
from collections.abc import Callable
from typing import Any, Final

from cyclonedds.core import DDSException

from air_router.ros2.messages import HEADER, Values, definitions, spaces
from mocha_link.bridges import Dds
from mocha_link.ros import RosCodec, RosError

_DEPTH: Final = 10
_MATCH_S, _POLL_S = 0.2, 0.005
"""So long a reply waits for a client whose request was faster than its own subscription."""

_LOG = logging.getLogger(__name__)

Take = Callable[[Values], None]


class RosGraph:
    """One participant of a DDS domain.

    Args:
        domain: Its number; None: that of ROS_DOMAIN_ID, or 0.
    """

    def __init__(self, domain: int | None = None) -> None:
        texts = definitions()
        self._codec = RosCodec(texts)
        self._dds = Dds(texts, domain=domain, spaces=spaces(texts))
        self._readers: dict[str, Any] = {}  # requests, by reply topic

    def advertise(self, topic: str, kind: str, depth: int = 1, *, lasting: bool = True) -> None:
        """Let others see a topic; `lasting`: its newest message comes to late subscribers."""
        self._dds.advertise(topic, kind, depth, lasting=lasting)

    def publish(self, topic: str, kind: str, values: Values) -> None:
        """Publish on a topic that is advertised; what readers are too slow for is left out."""
        try:
            self._dds.publish(topic, kind, 1, self._codec.encode(kind, values, 2))
        except DDSException as error:
            _LOG.warning("%s: a message was left out: %s", topic, error)

    def subscribe(self, topic: str, kind: str, take: Take) -> Any:
        """Hand over the messages of a topic, from another thread; what cannot be read is not.

        Gives the reader.
        """

        def read(data: bytes) -> None:
            with contextlib.suppress(RosError):
                take(self._codec.to_json(kind, self._codec.decode(kind, data, 2)))

        return self._dds.subscribe(topic, kind, _DEPTH, read)

    def serve(self, service: str, kind: str, take: Take) -> None:
        """Hand over requests to a service, from another thread; those that cannot be read are not.

        `kind`: of the service, e.g. ``std_srvs/Trigger``.
        """
        reply = f"rr{service}Reply"
        self._dds.advertise(reply, f"{kind}_Response", _DEPTH, lasting=False)
        self._readers[reply] = self.subscribe(f"rq{service}Request", f"{kind}_Request", take)

    def reply(self, service: str, kind: str, request: Values, values: Values) -> None:
        """Answer a request."""
        topic, kind = f"rr{service}Reply", f"{kind}_Response"
        writer, reader = self._dds.advertise(topic, kind, _DEPTH), self._readers[topic]
        until_s = time.monotonic() + _MATCH_S
        while time.monotonic() < until_s and len(writer.get_matched_subscriptions()) < len(
            reader.get_matched_publications()
        ):
            time.sleep(_POLL_S)
        header = {key: request[key] for key in HEADER}
        self.publish(topic, kind, {**header, **values})

    def close(self) -> None:
        """Leave the domain."""
        self._dds.close()
