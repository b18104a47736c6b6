"""Who may hand on whose messages."""

from dataclasses import replace
from functools import partial

import pytest

from mocha_link.store import wire
from mocha_link.store.trust import SignatureError, Verifier, sign
from mocha_link.store.wire import Header, PayloadError
from mocha_link.team.keys import SecretKey
from mocha_link.team.team import Team, Trust
from tests.mocha_link.original import packed

STAMP_MS = 1_795_175_905_123
TITAN, IO = SecretKey(b"t" * 32), SecretKey(b"i" * 32)


@pytest.fixture
def mixed(team) -> Team:
    """titan and io have keys, callisto runs the original node."""
    return team.with_robots(
        {
            "titan": {"key": TITAN.public.text},
            "io": {"key": IO.public.text},
            "callisto": {"original": True},
        }
    )


def message(team, robot, topic="/map", *, by=None, stamp_ms=STAMP_MS, **changes):
    """A header and a body, signed by a key, or with a `signature` that there is already."""
    known = team.topic(robot, topic)
    signs = partial(sign, by, team.robot(robot), known) if by else None
    if "signature" in changes:
        signs = lambda _: changes["signature"]  # noqa: E731
    data, priority = changes.get("data", b"data"), changes.get("priority", known.priority)
    body = packed(known.dtype, priority, data)
    if stamp_ms is not None:
        body = wire.pack(known.dtype, priority, data, stamp_ms=stamp_ms, sign=signs)
    header = Header.at(team.robot(robot).robot_id, known.topic_id, stamp_ms or STAMP_MS)
    return header, body


def verify(team: Team, header: Header, body: bytes, handed_by: str) -> None:
    Verifier(team).verify(header, body, wire.check(body), handed_by=handed_by)


@pytest.mark.parametrize("handed_by", ["titan", "io", "callisto"])
def test_what_is_not_signed(mixed, handed_by):
    for stamp_ms in (STAMP_MS, None):  # with a trailer, and without one
        unsigned = message(mixed, "titan", stamp_ms=stamp_ms)
        verify(mixed, *unsigned, handed_by)
        with pytest.raises(SignatureError, match=f"not signed by titan, handed on by {handed_by}"):
            verify(replace(mixed, trust=Trust.SIGNED), *unsigned, handed_by)


def test_robots_without_a_key(mixed):
    original = message(mixed, "callisto", "/pose", stamp_ms=None)
    for handed_by in ("callisto", "titan", "io"):
        verify(mixed, *original, handed_by)
    strict = replace(mixed, trust=Trust.SIGNED)
    verify(strict, *original, "callisto")
    with pytest.raises(
        SignatureError, match=r"callisto has no key: .* from itself only, not from io"
    ):
        verify(strict, *original, "io")


@pytest.mark.parametrize("trust", ["relays", "signed"])
def test_a_wrong_signature_is_worse_than_none(mixed, trust):
    team = replace(mixed, trust=Trust(trust))
    for handed_by in ("titan", "io", "callisto"):
        with pytest.raises(SignatureError, match=f"not of titan, handed on by {handed_by}"):
            verify(team, *message(team, "titan", by=IO), handed_by)
    assert issubclass(SignatureError, PayloadError)


def test_a_signature_that_no_key_can_check_counts_as_none(mixed):
    verify(mixed, *message(mixed, "callisto", "/pose", by=IO), "callisto")


def test_a_signature_holds_for_this_message_only(mixed):
    header, body = message(mixed, "titan", by=TITAN)
    signature = wire.check(body).signature
    for changes in (
        {"topic": "/slow"},
        {"stamp_ms": STAMP_MS + 1},
        {"stamp_ms": STAMP_MS + 65_536_000},
        {"data": b"date"},
        {"priority": 0},
    ):
        forged = message(mixed, "titan", signature=signature, **changes)
        with pytest.raises(SignatureError):
            verify(mixed, *forged, "io")
    assert message(mixed, "titan", signature=signature) == (header, body)


def test_the_header_cannot_be_another_one(mixed):
    header, body = message(mixed, "titan", by=TITAN)
    for other in (
        replace(header, seconds=header.seconds + 1),
        replace(header, milliseconds=header.milliseconds + 1),
    ):
        with pytest.raises(SignatureError, match="the time of another message"):
            verify(mixed, other, body, "titan")
    with pytest.raises(SignatureError, match="not of titan"):
        verify(mixed, replace(header, topic_id=1), body, "titan")
    with pytest.raises(SignatureError, match="not of io"):
        verify(mixed, replace(header, robot_id=mixed.robot("io").robot_id), body, "io")


def test_another_name_is_another_message(mixed):
    """Ids may mean something else in another team file: the names are signed as well."""
    header, body = message(mixed, "titan", by=TITAN)
    topics = mixed.kinds["aerial_robot"]
    renamed = (topics[0].model_copy(update={"name": "/goal"}), *topics[1:])
    other = replace(mixed, kinds={**mixed.kinds, "aerial_robot": renamed})
    with pytest.raises(SignatureError, match="not of titan"):
        verify(other, header, body, "titan")


def test_what_the_team_does_not_know(mixed):
    header, body = message(mixed, "titan", by=TITAN)
    with pytest.raises(SignatureError, match="not of this team"):
        verify(mixed, replace(header, robot_id=77), body, "titan")
