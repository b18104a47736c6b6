"""Packets that only the peer opens, once they arrive as they were sent."""

import hashlib
import os

import nacl.bindings
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.team.keys import OVERHEAD_BYTES, Seal, SealError, SecretKey

TITAN, IO, EUROPA = (SecretKey(bytes([number]) * 32) for number in (1, 2, 3))
OUT, IN = Seal(TITAN, IO.public), Seal(IO, TITAN.public)


@given(st.binary(max_size=1300))
def test_the_peer_opens_what_was_sealed_for_it(packet):
    sealed = OUT.seal(packet)
    assert IN.open(sealed) == packet
    assert len(sealed) == len(packet) + OVERHEAD_BYTES
    assert OVERHEAD_BYTES <= 40
    assert packet not in sealed or len(packet) < 4
    assert OUT.seal(packet) != sealed


def test_others_open_nothing():
    assert OUT.open(IN.seal(b"back")) == b"back"
    sealed = OUT.seal(b"for io")
    assert OUT.open(sealed) is None  # sent back to its sender
    assert Seal(EUROPA, TITAN.public).open(sealed) is None
    assert Seal(IO, EUROPA.public).open(sealed) is None
    assert IN.open(Seal(EUROPA, IO.public).seal(b"as if from titan")) is None


def test_the_cipher_is_the_one_of_the_docs():
    """What another implementation has to do, step by step."""
    shared = nacl.bindings.crypto_box_beforenm(IO.public.curve, TITAN.curve)
    key = hashlib.blake2b(
        TITAN.public.curve + IO.public.curve,
        key=shared,
        person=b"mocha-link udp 1",
        digest_size=32,
    ).digest()
    nonce = os.urandom(24)
    assert IN.open(nonce + nacl.bindings.crypto_secretbox(b"packet", nonce, key)) == b"packet"


def test_a_key_that_shares_no_secret():
    broken = SecretKey(bytes(32)).public
    object.__setattr__(broken, "curve", bytes(32))
    with pytest.raises(SealError, match="not a key to share a secret with"):
        Seal(TITAN, broken)
