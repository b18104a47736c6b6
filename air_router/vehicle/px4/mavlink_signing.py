"""MAVLink signatures: signs all messages to the vehicle, and verifies all messages from it.

As in https://mavlink.io/en/guide/message_signing.html, and in PX4 from 1.18 on. MAVSDK has no
signing, so it is done between MAVSDK and the link, on whole frames: MAVSDK receives only frames
with a valid signature. This module has no socket, and its clock is injected.

pymavlink is not used: it is no dependency of a flight, and its check stores the timestamp of a
    forged message, after which it rejects genuine ones as old.
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
"""Messages accepted without a signature, with the seeds of their checksums: RADIO_STATUS, because a
telemetry radio has no key. PX4 also accepts HEARTBEAT; here it carries the flight mode and must be
signed."""


class Verdict(Enum):
    """The verdict on a received frame."""

    GOOD = "signed with the key, and new"
    EXEMPT = "unsigned, of a kind that is accepted unsigned"
    UNSIGNED = "unsigned"
    FORGED = "signed with another key, or modified"
    OLD = "signed with the key, but no newer than an earlier one"


TAKEN: Final = frozenset({Verdict.GOOD, Verdict.EXEMPT})
_POSING: Final = frozenset({Verdict.UNSIGNED, Verdict.FORGED})


def timestamp_of(unix_s: float) -> int:
    """A time in the units of signatures."""
    return min(max(round((unix_s - SIGNING_EPOCH_UNIX_S) / SIGNING_UNIT_S), 0), LAST_TIMESTAMP)


class MavlinkSigner:
    """Signs sent frames and verifies received ones. Any thread may call it.

    Args:
        key: The secret key.
        system_id: The vehicle's system id.
        last: The latest timestamp that may have been used already.
        store: Stores a timestamp that is not reached before the next call.
        unix_s: This machine's clock, which may be behind and may be set.

    Attributes:
        counts: Frames by verdict.
        posing: Frames with the vehicle's system id but without a valid signature.
        stale_heartbeat: The latest datagram had an old HEARTBEAT signed with the key: its sender
            has restarted, and adopts our time with our next message.
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
        self._latest = last  # signed with, or received
        self._store, self._reserved = store, last
        self._unix_s = unix_s
        self._senders: dict[tuple[int, int, int], int] = {}  # latest timestamp by sender
        self._lock = threading.Lock()

    @classmethod
    def from_file(cls, path: Path, system_id: int) -> Self:
        """Read the key file, and the time of the last signature beside it.

        Raises:
            SigningKeyError: as `SigningKey.read`.
        """
        key, times = SigningKey.read(path), TimestampFile(path)
        return cls(key, system_id, times.load(), store=times.store)

    def sign(self, frames: bytes) -> bytes:
        """Sign frames, which must be sent in this order.

        Args:
            frames: Whole frames. MAVLink 1 frames cannot be signed and are dropped.
        """
        with self._lock:
            return b"".join(self._signed(each) for each in frames_of(frames) if _is_plain(each))

    def close(self) -> None:
        """End signing: the next session starts at the last timestamp of this one."""
        with self._lock:
            self._store(self._latest)
        for verdict, count in self.counts.items():
            _log.info("%d MAVLink messages were %s", count, verdict.value)

    def received(self, datagram: bytes) -> bytes:
        """Verify a datagram of whole frames; return the accepted ones without signatures."""
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
        """Verify a whole frame, and store its timestamp if the signature is valid."""
        header = header_of(frame)
        if not is_signed(frame):
            seed = EXEMPT.get(header.message_id)
            taken = seed is not None and is_intact(frame, seed)
            return Verdict.EXEMPT if taken else Verdict.UNSIGNED
        content, digest = frame[:-SIGNATURE_HASH_BYTES], frame[-SIGNATURE_HASH_BYTES:]
        if not hmac.compare_digest(self._digest(content), digest):
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
        """Count a verified frame."""
        self.counts[verdict] += 1
        sender = header_of(frame)[:2]
        self.posing += verdict in _POSING and sender == (self._system_id, AUTOPILOT)

    @property
    def why_none_is_taken(self) -> str:
        """Why no received frame was accepted, and what to do; empty: nothing was received."""
        found = self.counts
        if found[Verdict.FORGED]:
            return (
                "MAVLink is received, but signed with another key; take the file of the key that "
                "PX4 has, or give PX4 another one (docs/security.md)"
            )
        if found[Verdict.UNSIGNED]:
            return (
                "MAVLink is received, but it is not signed; give PX4 this key with `air-router "
                "signing-key FILE --connect URL` (PX4 1.18 or newer), or fly without --signing-key"
            )
        if found[Verdict.OLD]:
            return (
                "MAVLink is received, signed with this key but with old timestamps: PX4 corrects "
                "its time once it receives our messages; check the link towards PX4"
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
        """The hash of a signed frame without its own hash."""
        return hashlib.sha256(self._key.secret + frame).digest()[:SIGNATURE_HASH_BYTES]

    def _now(self) -> int:
        return timestamp_of(self._unix_s())


def as_taken(frame: bytes, verdict: Verdict) -> bytes:
    """The frame for MAVSDK, without a signature; empty if it was rejected."""
    if verdict is Verdict.GOOD:
        return without_signature(frame)
    return frame if verdict is Verdict.EXEMPT else b""


def _is_plain(frame: bytes) -> bool:
    return frame[0] == MAVLINK_2 and not is_signed(frame)


class SignedStream:
    """Extracts accepted frames from a stream of bytes: a serial line, or TCP.

    A frame has no end mark, and bytes may be lost or damaged. If a supposed frame is rejected, the
    next one may start within it.

    Args:
        signer: Verifies frames.
    """

    def __init__(self, signer: MavlinkSigner) -> None:
        self._signer = signer
        self._data = bytearray()  # not verified yet
        self._blamed = 0  # bytes of a rejected frame, which is counted once

    def received(self, data: bytes) -> bytes:
        """Handle received bytes; return the accepted frames without signatures."""
        self._data += data
        taken, at = [], 0
        while at < len(self._data):
            length = length_at(self._data, at)
            if length is None or at + length > len(self._data):
                break  # the rest is not received yet
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
