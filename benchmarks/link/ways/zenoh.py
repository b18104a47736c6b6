"""eclipse-zenoh over TCP: a fresh session per contact, and one get of all that is missing.

A fresh session did better than a kept one, which sleeps in TCP's back-off when a contact begins.
The query lists what is there already, so nothing comes twice; replies are passed on one by one.
"""

import contextlib
import json
import threading
from typing import Any

import zenoh

from benchmarks.link.offer import Offer
from benchmarks.link.ways import ADDRESSES, Deliver

ENDPOINT = f"tcp/{ADDRESSES[0]}:7447"
PREFIX = "message"
GET_S = 600.0
LEASE_MS = 4000  # less than a gap: what is left of the last contact must not stand in the way


class ZenohSource:
    def __init__(self, offer: Offer) -> None:
        self._messages = {key: offer.data(key) for key in range(offer.count)}
        self._session: Any = None

    def start(self) -> None:
        self._session = zenoh.open(_config(mode="peer", listen=[ENDPOINT]))
        self._session.declare_queryable(f"{PREFIX}/*", self._queried, complete=True)

    def signal_received(self, *, again: bool) -> None:
        pass

    def lost(self) -> None:
        pass

    def close(self) -> None:
        pass  # the process ends; closing would wait for a peer that is out of reach

    def data(self, key: int) -> bytes | None:
        return self._messages.get(key)

    def _queried(self, query: Any) -> None:
        threading.Thread(target=self._answer, args=(query,), daemon=True).start()

    def _answer(self, query: Any) -> None:
        have = query.payload.to_bytes() if query.payload else b""
        with contextlib.nullcontext(), query:
            for key in sorted(self._messages, reverse=True):
                if not have[key // 8] >> key % 8 & 1:
                    query.reply(
                        f"{PREFIX}/{key}",
                        self._messages[key],
                        congestion_control=zenoh.CongestionControl.BLOCK,
                    )


class ZenohSink:
    def __init__(self, offer: Offer, deliver: Deliver) -> None:
        self._offer = offer
        self._deliver = deliver
        self._messages: dict[int, bytes] = {}
        self._over = threading.Event()

    def start(self) -> None:
        pass

    def signal_received(self, *, again: bool) -> None:
        if not again:
            self._over = threading.Event()
            threading.Thread(target=self._pull, daemon=True).start()

    def lost(self) -> None:
        self._over.set()

    def close(self) -> None:
        self._over.set()

    def data(self, key: int) -> bytes | None:
        return self._messages.get(key)

    def _pull(self) -> None:
        over = self._over
        config = _config("client", connect=[ENDPOINT])
        with contextlib.suppress(zenoh.ZError), zenoh.open(config) as session:
            have = bytearray((self._offer.count + 7) // 8)
            for key in self._messages:
                have[key // 8] |= 1 << key % 8
            session.get(
                f"{PREFIX}/*",
                self._take,
                payload=bytes(have),
                timeout=GET_S,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
            over.wait()

    def _take(self, reply: Any) -> None:
        if reply.ok:
            key = int(str(reply.ok.key_expr).rpartition("/")[2])
            self._messages[key] = reply.ok.payload.to_bytes()
            self._deliver(key)


def _config(mode: str, **endpoints: list[str]) -> Any:
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")
    config.insert_json5("transport/link/tx/lease", str(LEASE_MS))
    config.insert_json5("listen/endpoints", json.dumps(endpoints.get("listen", [])))
    config.insert_json5("connect/endpoints", json.dumps(endpoints.get("connect", [])))
    return config
