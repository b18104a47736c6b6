"""CycloneDDS: a reliable, transient-local topic, the newest sample of a key for every message.

Tuned for such links: packets that fit, unicast, discovery every quarter of a second, a lease that
outlives a gap (so that none is discovered anew), retransmissions in bursts that a queue can hold.
"""

import threading
from dataclasses import dataclass
from typing import Any

from cyclonedds.core import Listener, Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import key as key_field
from cyclonedds.idl.types import sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from benchmarks.link.namespaces import INTERFACE
from benchmarks.link.offer import Offer
from benchmarks.link.ways import ADDRESSES, Deliver

# The peer's port belongs to its address: without it, a hundred ports are tried, which fills a slow
# link. Resending up to 64 kB at once did as well as or better than 16 kB and the default 1 MB.
CONFIG = f"""<CycloneDDS><Domain>
<General>
<Interfaces><NetworkInterface name="{INTERFACE}" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast>
<MaxMessageSize>1400B</MaxMessageSize>
<FragmentSize>1300B</FragmentSize>
</General>
<Discovery>
<ParticipantIndex>0</ParticipantIndex>
<Peers><Peer address="{{peer}}:7410"/></Peers>
<SPDPInterval>250ms</SPDPInterval>
<LeaseDuration>120s</LeaseDuration>
</Discovery>
<Internal>
<HeartbeatInterval min="100ms" minsched="100ms" max="100ms">100ms</HeartbeatInterval>
<BurstSize><MaxRexmit>64kB</MaxRexmit><MaxInitTransmit>64000</MaxInitTransmit></BurstSize>
<MaxQueuedRexmitBytes>64kB</MaxQueuedRexmitBytes>
</Internal>
</Domain></CycloneDDS>"""


@dataclass
class Message(IdlStruct, typename="Message"):
    key: uint32
    key_field("key")
    data: sequence[uint8]  # type: ignore[type-arg]


class _DdsSide:
    def __init__(self) -> None:
        self._parts: list[Any] = []

    def _join(self, peer: str) -> tuple[Any, Any, Any]:
        domain = Domain(0, CONFIG.format(peer=peer))
        participant = DomainParticipant(0)
        qos = Qos(
            Policy.Reliability.Reliable(duration(infinite=True)),
            Policy.Durability.TransientLocal,
            Policy.History.KeepLast(1),
        )
        topic = Topic(participant, "messages", Message, qos=qos)
        self._parts = [domain, participant, topic]
        return participant, topic, qos

    def signal_received(self, *, again: bool) -> None:
        pass  # it finds its peers by itself

    def lost(self) -> None:
        pass

    def close(self) -> None:
        pass  # the process ends; closing waits long for a peer that is out of reach


class DdsSource(_DdsSide):
    def __init__(self, offer: Offer) -> None:
        super().__init__()
        self._messages = {key: offer.data(key) for key in range(offer.count)}

    def start(self) -> None:
        participant, topic, qos = self._join(ADDRESSES[1])
        writer = DataWriter(participant, topic, qos=qos)
        self._parts.append(writer)
        for key, data in self._messages.items():
            writer.write(Message(key=key, data=data))  # type: ignore[arg-type]

    def data(self, key: int) -> bytes | None:
        return self._messages.get(key)


class DdsSink(_DdsSide):
    def __init__(self, _offer: Offer, deliver: Deliver) -> None:
        super().__init__()
        self._messages: dict[int, bytes] = {}
        self._deliver = deliver
        self._taking = threading.Lock()

    def start(self) -> None:
        participant, topic, qos = self._join(ADDRESSES[0])
        arrived = self._arrived

        class Notice(Listener):
            def on_data_available(self, reader: Any) -> None:
                arrived(reader)

        notice = Notice()  # type: ignore[no-untyped-call]
        self._parts.append(DataReader(participant, topic, qos=qos, listener=notice))

    def data(self, key: int) -> bytes | None:
        return self._messages.get(key)

    def _arrived(self, reader: Any) -> None:
        with self._taking:
            for message in reader.take(64):  # an InvalidSample notes a disposal
                if isinstance(message, Message) and message.key not in self._messages:
                    self._messages[message.key] = bytes(message.data)
                    self._deliver(message.key)
