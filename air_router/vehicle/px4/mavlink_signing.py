"""MAVLink's signatures: of all that leaves for the vehicle, and on all that comes from it.

As https://mavlink.io/en/guide/message_signing.html has it, and PX4 from 1.18 on. MAVSDK does
neither, so it is done between MAVSDK and the link, on whole frames: it gets none that the key does
not vouch for. Here is no socket, and the clock is injected.

pymavlink can do it too, and is no package of a flight; its check remembers the timestamp of a
forged message, after which it takes the genuine ones for old.
"""

import hashlib
import hmac
import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from enum import Enum
from pathlib import Path
from typing import Final, Self

from air_router.vehicle.px4.limits import (
    SIGNING_LINK_ID,
    SIGNING_NEW_SENDER_S,
    SIGNING_RESERVED_S,
    SIGNING_REWRITTEN_S,
)
from air_router.vehicle.px4.mavlink_frame import (
    flagged,
    frames_of,
    header_of,
    is_intact,
    is_signed,
    length_at,
    without_signature,
)
from air_router.vehicle.px4.mavlink_values import (
    AUTOPILOT,
    LAST_TIMESTAMP,
    MAVLINK_2,
    SIGNATURE_BYTES,
    SIGNATURE_HASH_BYTES,
    SIGNING_EPOCH_UNIX_S,
    SIGNING_UNIT_S,
    MessageId,
)
from air_router.vehicle.px4.signing_key import SigningKey, TimestampFile

_log = logging.getLogger(__name__)


EXEMPT: Final[Mapping[int, int]] = {MessageId.RADIO_STATUS: 185}
"""Messages that are taken without a signature, and the seeds of their checksums: that of a
telemetry radio, which has no key. PX4 takes HEARTBEAT as well; here it has the mode that a pilot
chose, and is not taken."""


class Verdict(Enum):
    """What a frame that came is."""

    GOOD = "signed with the key, and new"
    EXEMPT = "unsigned, of a kind that is taken so"
    UNSIGNED = "unsigned"
    FORGED = "signed with another key, or changed"
    OLD = "signed with the key, and no newer than one before"


TAKEN: Final = frozenset({Verdict.GOOD, Verdict.EXEMPT})
_POSING: Final = frozenset({Verdict.UNSIGNED, Verdict.FORGED})


def timestamp_of(unix_s: float) -> int:
    """A time as signatures have it."""
    return min(max(round((unix_s - SIGNING_EPOCH_UNIX_S) / SIGNING_UNIT_S), 0), LAST_TIMESTAMP)


class MavlinkSigner:
    """Signs frames, and judges those that come. Any thread may call it.

    Args:
        key: The secret.
        system_id: The vehicle's.
        last: The latest timestamp that may have been used before.
        store: Takes a timestamp that is not reached before the next call.
        unix_s: The clock of this machine, which may be behind and may be set.

    Attributes:
        counts: Frames by verdict.
        posing: Those that report that they are the vehicle's, and that the key does not vouch for.
        stale_heartbeat: The latest datagram had an old HEARTBEAT that was signed with the key: its
            sender has restarted, and goes by our time as soon as it gets a message of ours.
    """

    def __init__(
        self,
        key: SigningKey,
        system_id: int,
        last: int = 0,
        *,
        store: Callable[[int], None] = lambda _: None,
        unix_s: Callable[[], float] = time.time,
    ) -> None:
        self.counts: Counter[Verdict] = Counter()
        self.posing = 0
        self.stale_heartbeat = False
        self._key, self._system_id = key, system_id
        self._latest = last  # that we have signed with, or have received
        self._store, self._reserved = store, last
        self._unix_s = unix_s
        self._senders: dict[tuple[int, int, int], int] = {}  # the latest timestamp of each
        self._lock = threading.Lock()

    @classmethod
    def from_file(cls, path: Path, system_id: int) -> Self:
        """With the key in a file, and beside it the time of the last signature.

        Raises:
            SigningKeyError: as `SigningKey.read`.
        """
        key, times = SigningKey.read(path), TimestampFile(path)
        return cls(key, system_id, times.load(), store=times.store)

    def sign(self, frames: bytes) -> bytes:
        """Sign what leaves; it must leave in this order.

        Args:
            frames: Whole frames. Those that cannot be signed, of MAVLink 1, are left out.
        """
        with self._lock:
            return b"".join(self._signed(each) for each in frames_of(frames) if _is_plain(each))

    def close(self) -> None:
        """Nothing more is signed: the next time begins where this one ends."""
        with self._lock:
            self._store(self._latest)
        for verdict, count in self.counts.items():
            _log.info("%d MAVLink messages were %s", count, verdict.value)

    def received(self, datagram: bytes) -> bytes:
        """Judge a datagram of whole frames; returns those that are taken, without signatures."""
        self.stale_heartbeat = False
        taken = []
        for frame in frames_of(datagram):
            verdict = self.judge(frame)
            self.count(frame, verdict)
            taken.append(as_taken(frame, verdict))
            if verdict is Verdict.OLD and header_of(frame).message_id == MessageId.HEARTBEAT:
                self.stale_heartbeat = True
        return b"".join(taken)

    def judge(self, frame: bytes) -> Verdict:
        """Judge a whole frame, and remember its timestamp if the key vouches for it."""
        header = header_of(frame)
        if not is_signed(frame):
            seed = EXEMPT.get(header.message_id)
            taken = seed is not None and is_intact(frame, seed)
            return Verdict.EXEMPT if taken else Verdict.UNSIGNED
        said, digest = frame[:-SIGNATURE_HASH_BYTES], frame[-SIGNATURE_HASH_BYTES:]
        if not hmac.compare_digest(self._digest(said), digest):
            return Verdict.FORGED
        sender = (header.system_id, header.component_id, frame[-SIGNATURE_BYTES])
        timestamp = int.from_bytes(frame[1 - SIGNATURE_BYTES : -SIGNATURE_HASH_BYTES], "little")
        with self._lock:
            latest = self._senders.get(sender)
            if latest is None:
                behind = round(SIGNING_NEW_SENDER_S / SIGNING_UNIT_S)
                latest = max(self._latest, self._now()) - behind - 1
            if not latest < timestamp < LAST_TIMESTAMP:
                return Verdict.OLD
            self._senders[sender] = timestamp
            self._latest = max(self._latest, timestamp)
        return Verdict.GOOD

    def count(self, frame: bytes, verdict: Verdict) -> None:
        """Count a frame that was judged."""
        self.counts[verdict] += 1
        sender = header_of(frame)[:2]
        self.posing += verdict in _POSING and sender == (self._system_id, AUTOPILOT)

    @property
    def why_none_is_taken(self) -> str:
        """Why nothing that came was the vehicle's, and what to do; empty: nothing came."""
        found = self.counts
        if found[Verdict.FORGED]:
            return (
                "MAVLink comes, but signed with another key; take the file of the key that PX4 "
                "has, or give PX4 another one (docs/security.md)"
            )
        if found[Verdict.UNSIGNED]:
            return (
                "MAVLink comes, but it is not signed; give PX4 this key with `air-router "
                "signing-key FILE --connect URL` (PX4 1.18 or newer), or fly without --signing-key"
            )
        if found[Verdict.OLD]:
            return (
                "MAVLink comes, signed with this key and old: PX4 goes by our time once it "
                "receives our messages; see to it that it does"
            )
        return ""

    def _signed(self, frame: bytes) -> bytes:
        self._latest = timestamp = max(self._latest + 1, self._now())
        if timestamp + round(SIGNING_REWRITTEN_S / SIGNING_UNIT_S) > self._reserved:
            self._reserved = timestamp + round(SIGNING_RESERVED_S / SIGNING_UNIT_S)
            self._store(self._reserved)
        signed = flagged(frame) + bytes((SIGNING_LINK_ID,)) + timestamp.to_bytes(6, "little")
        return signed + self._digest(signed)

    def _digest(self, frame: bytes) -> bytes:
        """What proves a signed frame, whose own proof is left out."""
        return hashlib.sha256(self._key.secret + frame).digest()[:SIGNATURE_HASH_BYTES]

    def _now(self) -> int:
        return timestamp_of(self._unix_s())


def as_taken(frame: bytes, verdict: Verdict) -> bytes:
    """A frame as MAVSDK gets it, without a signature; empty if it gets none."""
    if verdict is Verdict.GOOD:
        return without_signature(frame)
    return frame if verdict is Verdict.EXEMPT else b""


def _is_plain(frame: bytes) -> bool:
    return frame[0] == MAVLINK_2 and not is_signed(frame)


class SignedStream:
    """Cuts the frames that are taken out of a stream of bytes: a serial line, or TCP.

    A frame has no mark at its end, and bytes are lost or damaged: where the bytes that seem to be
    one are not taken, the next may begin within them.

    Args:
        signer: Judges them.
    """

    def __init__(self, signer: MavlinkSigner) -> None:
        self._signer = signer
        self._data = bytearray()  # not judged yet
        self._blamed = 0  # of it, bytes of a frame that was not taken: it is counted once

    def received(self, data: bytes) -> bytes:
        """Take bytes in; returns the frames that are taken, without signatures."""
        self._data += data
        taken, at = [], 0
        while at < len(self._data):
            length = length_at(self._data, at)
            if length is None or at + length > len(self._data):
                break  # the rest is still to come
            if length == 0:
                at += 1
                continue
            frame = bytes(self._data[at : at + length])
            verdict = self._signer.judge(frame)
            if verdict in TAKEN or at >= self._blamed:
                self._signer.count(frame, verdict)
                self._blamed = at + length
            taken.append(as_taken(frame, verdict))
            at += length if verdict in TAKEN else 1
        del self._data[:at]
        self._blamed = max(self._blamed - at, 0)
        return b"".join(taken)
