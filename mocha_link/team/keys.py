"""Who a robot is: an Ed25519 key pair. The team file has the public half, a file the secret one.

The Curve25519 keys of encrypted links and of sealed datagrams are derived from the same pair, so a
robot has one key.
Needs the extra ``keys`` (PyNaCl); importing this module does not.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from zmq.utils import z85

from mocha_link.errors import MissingExtraError, MochaLinkError
from mocha_link.loopback import is_loopback
from mocha_link.team.team import Robot, Team

try:
    import nacl.bindings
    import nacl.exceptions
    import nacl.signing
except ImportError:  # pragma: no cover - the development set-up has it
    _AVAILABLE = False
else:
    _AVAILABLE = True

SEED_BYTES = 32
Z85_CHARACTERS = 40
_FILE_BYTES = 4096
NONCE_BYTES = 24
OVERHEAD_BYTES = NONCE_BYTES + 16  # of a sealed packet
_PURPOSE = b"mocha-link udp 1"


class KeysUnavailableError(MissingExtraError):
    """Keys are configured, and the library that reads them is not installed."""

    def __init__(self) -> None:
        super().__init__("what has keys", "PyNaCl", "keys")


class KeyFileError(MochaLinkError):
    """A secret key file that is missing, is not one, or that others can read."""


class KeyMismatchError(MochaLinkError):
    """A key that is not one, or a secret that is not of the public key in the team file."""


@dataclass(frozen=True, slots=True)
class PublicKey:
    """The public half, as the team file has it (Z85, 40 characters).

    Raises:
        KeyMismatchError: not a key of this kind.
        KeysUnavailableError: PyNaCl is missing.
    """

    text: str  # Z85
    raw: bytes = field(init=False, repr=False)  # Ed25519
    curve: bytes = field(init=False, repr=False)  # X25519, for sealing and CURVE

    def __post_init__(self) -> None:
        require()
        raw = _decoded(self.text)
        try:
            curve = nacl.bindings.crypto_sign_ed25519_pk_to_curve25519(raw)
        except nacl.exceptions.RuntimeError:
            raise KeyMismatchError(
                f"'{self.text}' is not a public key; write one with 'mocha-link keys'"
            ) from None
        object.__setattr__(self, "raw", raw)
        object.__setattr__(self, "curve", curve)

    def proves(self, signature: bytes, message: bytes) -> bool:
        """Whether the holder of the secret half made this signature of the message."""
        try:
            nacl.bindings.crypto_sign_open(signature + message, self.raw)
        except (nacl.exceptions.BadSignatureError, nacl.exceptions.ValueError):
            return False
        return True


@dataclass(frozen=True, slots=True)
class SecretKey:
    """The secret half: 32 random bytes. It never shows itself in a log."""

    seed: bytes = field(repr=False)  # of the Ed25519 key
    public: PublicKey = field(init=False)
    curve: bytes = field(init=False, repr=False)  # X25519
    _signing: bytes = field(init=False, repr=False)  # Ed25519, as PyNaCl takes it

    def __post_init__(self) -> None:
        require()
        raw, signing = nacl.bindings.crypto_sign_seed_keypair(self.seed)
        object.__setattr__(self, "public", PublicKey(_encoded(raw)))
        object.__setattr__(self, "_signing", signing)
        curve = nacl.bindings.crypto_sign_ed25519_sk_to_curve25519(signing)
        object.__setattr__(self, "curve", curve)

    @classmethod
    def generate(cls) -> SecretKey:
        """A new key pair."""
        return cls(os.urandom(SEED_BYTES))

    def sign(self, message: bytes) -> bytes:
        """The signature of a message by this key, 64 bytes."""
        signed: bytes = nacl.bindings.crypto_sign(message, self._signing)
        return signed[: nacl.bindings.crypto_sign_BYTES]


def available() -> bool:
    """Whether PyNaCl is there."""
    return _AVAILABLE


def require() -> None:
    """Raise KeysUnavailableError unless keys can be used here."""
    if not available():
        raise KeysUnavailableError


def public_key(robot: Robot) -> PublicKey | None:
    """The key that the team file has for a robot. Raises as `PublicKey`."""
    if robot.key is None:
        return None
    try:
        return PublicKey(robot.key)
    except KeyMismatchError as error:
        raise KeyMismatchError(f"key of {robot.name} in the team file: {error}") from None


def secret_key(team: Team, name: str, directory: Path | None) -> SecretKey | None:
    """The secret of a robot, from ``<name>.key`` in `directory`; None if the team has no key of it.

    Raises:
        KeyFileError: no directory, no file there, others can read it, or it holds no key.
        KeyMismatchError: it is not the secret of the key in the team file.
        KeysUnavailableError: PyNaCl is missing.
        UnknownRobotError: the team has no robot of that name.
    """
    public = public_key(team.robot(name))
    if public is None:
        return None
    if directory is None:
        raise KeyFileError(
            f"{team.path} has a key for {name}: give the folder of its secret, with "
            f"{name}.key (mocha-link node ... --keys DIR)"
        )
    path = path_of(name, directory)
    secret = read(path)
    if secret.public != public:
        raise KeyMismatchError(
            f"{path} is not the secret of the key that {team.path} has for {name}; copy the right "
            "file and the same team file to the robot, or make new keys with 'mocha-link keys "
            "--force'"
        )
    return secret


def peer_keys(team: Team, robot: Robot) -> dict[str, PublicKey]:
    """The keys of the peers that have one: links to them are encrypted."""
    keys = {peer: public_key(team.robot(peer)) for peer in robot.peers}
    return {peer: key for peer, key in keys.items() if key}


def open_because(robot: Robot, other: Robot) -> str | None:
    """Why the link of two robots is not protected by keys; None if it is."""
    for each in (robot, other):
        if each.original:
            return f"{each.name} runs the original MOCHA"
        if each.key is None:
            return f"{each.name} has no key"
    return None


def exposed(team: Team, robot: Robot) -> list[str]:
    """The peers whose ports of a robot need no key, if other machines can reach them."""
    if is_loopback(robot.listen):
        return []
    return [peer for peer in robot.peers if open_because(robot, team.robot(peer))]


def exposure(team: Team, robots: Iterable[Robot]) -> str | None:
    """One warning about ports that need no key and that other machines can reach; None: no such."""
    places = []
    for robot in robots:
        ports = ", ".join(str(robot.port_for(peer)) for peer in exposed(team, robot))
        where = "every interface" if robot.listen == "*" else robot.listen
        places += [f"{robot.name} on {where}, port {ports}"] if ports else []
    if not places:
        return None
    return (
        f"NO KEYS: any machine that reaches these ports can read all messages and publish in the "
        f"name of any robot: {'; '.join(places)}. Make keys (mocha-link keys --team {team.path}), "
        "or set 'listen: 127.0.0.1' where all robots are on one machine"
    )


def path_of(name: str, directory: Path) -> Path:
    """Where the secret of a robot is."""
    return directory / f"{name}.key"


def read(path: Path) -> SecretKey:
    """Read a secret key file. Raises KeyFileError or KeysUnavailableError."""
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            text = file.read(_FILE_BYTES).decode("ascii", "replace")
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise KeyFileError(f"cannot read the secret key {path}: {reason}") from None
    if stat.S_IMODE(mode) & 0o077:
        raise KeyFileError(
            f"others can read or change the secret key {path}; run: chmod 600 '{path}'"
        )
    lines = [line.strip() for line in text.splitlines() if not line.startswith("# ")]
    with contextlib.suppress(KeyMismatchError):
        return SecretKey(_decoded("".join(lines)))
    raise KeyFileError(f"{path} is not a secret key; copy it again, or make a new one")


def write(path: Path, name: str, secret: SecretKey, *, replace: bool = False) -> None:
    """Write a secret key file that only its owner can read. Raises KeyFileError."""
    text = f"# The secret key of {name}: it belongs on that robot only.\n{_encoded(secret.seed)}\n"
    fresh = path.with_name(path.name + ".new") if replace else path
    try:
        if replace:
            fresh.unlink(missing_ok=True)
        place = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(place, "w", encoding="ascii") as file:
            os.fchmod(place, 0o600)
            file.write(text)
            file.flush()
            os.fsync(place)
        if replace:
            fresh.replace(path)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise KeyFileError(f"cannot write the secret key {path}: {reason}") from None


def _encoded(raw: bytes) -> str:
    return bytes(z85.encode(raw)).decode("ascii")


def _decoded(text: str) -> bytes:
    """32 bytes from 40 characters of Z85. Raises KeyMismatchError."""
    if len(text) == Z85_CHARACTERS:
        with contextlib.suppress(ValueError, KeyError, struct.error):
            raw = bytes(z85.decode(text.encode("ascii")))
            if _encoded(raw) == text:
                return raw
    raise KeyMismatchError(f"'{text}' is not a key of {Z85_CHARACTERS} Z85 characters")


class SealError(MochaLinkError):
    """A packet that cannot be sealed for a peer."""


class Seal:
    """Seals packets for one peer and opens those that it sealed for us.

    Raises:
        SealError: the peer's key makes no shared secret.
    """

    def __init__(self, own: SecretKey, peer: PublicKey) -> None:
        mine, its = own.public.curve, peer.curve
        try:
            shared = nacl.bindings.crypto_box_beforenm(its, own.curve)
        except nacl.exceptions.CryptoError:
            raise SealError(f"'{peer.text}' is not a key to share a secret with") from None
        self._out = _key(shared, mine + its)  # key of what we send
        self._in = _key(shared, its + mine)  # key of what the peer sends

    def seal(self, packet: bytes) -> bytes:
        """The packet as it goes out: OVERHEAD_BYTES longer."""
        nonce = os.urandom(NONCE_BYTES)
        sealed: bytes = nacl.bindings.crypto_secretbox(packet, nonce, self._out)
        return nonce + sealed

    def open(self, sealed: bytes) -> bytes | None:
        """The packet that the peer sealed for us; None for anything else."""
        if len(sealed) < OVERHEAD_BYTES:
            return None
        try:
            packet: bytes = nacl.bindings.crypto_secretbox_open(
                sealed[NONCE_BYTES:], sealed[:NONCE_BYTES], self._in
            )
        except nacl.exceptions.CryptoError:
            return None
        return packet


def _key(shared: bytes, direction: bytes) -> bytes:
    return hashlib.blake2b(direction, key=shared, person=_PURPOSE, digest_size=32).digest()
