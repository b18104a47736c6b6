"""The URL by which a team file names the radio of a robot."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self
from urllib.parse import parse_qsl

from mocha_link.errors import RadioError

MAX_PORT = 65535

_HOST = r"[A-Za-z0-9][A-Za-z0-9._-]*"
_URL = re.compile(rf"(?P<scheme>[a-z]+):(?://(?P<host>{_HOST})(?::(?P<port>\d{{1,5}}))?)?")


@dataclass(frozen=True, slots=True)
class _Form:
    shown: str  # an example, for messages
    port: str  # "no", "may", "must"
    options: tuple[str, ...] = ()  # that such a URL may have
    host: bool = True  # it needs one


FORMS: Mapping[str, _Form] = {
    "udp": _Form("udp://host:port", "must"),
    "tcp": _Form("tcp://host:port", "must"),
    "stdin": _Form("stdin:", "no", host=False),
    "wifi": _Form("wifi://interface", "no"),
    "rajant": _Form("rajant://host:port or rajant://host?jar=monitor.jar", "may", ("jar",)),
    "mavlink": _Form("mavlink://host:port?peer=robot", "must", ("peer",)),
}


class RadioUrlError(RadioError, ValueError):
    """A text that is not the URL of a radio."""


@dataclass(frozen=True, slots=True)
class RadioUrl:
    """A radio's URL in its parts; `str` gives the text back."""

    scheme: str
    host: str
    port: int | None  # None: the URL has none
    options: Mapping[str, str] = field(hash=False)  # behind the question mark
    text: str  # as it was written

    @classmethod
    def parse(cls, text: str, scheme: str | None = None) -> Self:
        """Read a URL, of one scheme if that is given. Raises RadioUrlError."""
        head, mark, query = text.partition("?")
        match = _URL.fullmatch(head)
        found = match["scheme"] if match else head.partition(":")[0]
        form = FORMS.get(scheme or found)
        if form is None or match is None or (scheme and found != scheme):
            forms = [form] if form else FORMS.values()
            raise _wrong(text, ", ".join(form.shown for form in forms))
        port = int(match["port"]) if match["port"] else None
        try:
            pairs = parse_qsl(query, strict_parsing=True, max_num_fields=4) if mark else []
        except ValueError:
            raise _wrong(text, form.shown) from None
        options = dict(pairs)
        fits = (
            (match["host"] is not None) == form.host
            and (port is None or form.port != "no")
            and (port is not None or form.port != "must")
            and (port or 0) <= MAX_PORT
            and len(options) == len(pairs)
            and options.keys() <= set(form.options)
        )
        if not fits or (found == "rajant" and (port is None) != ("jar" in options)):
            raise _wrong(text, form.shown)
        return cls(found, match["host"] or "", port, options, text)

    def __str__(self) -> str:
        return self.text


def checked(text: str) -> str:
    """The text, if it is the URL of a radio. Raises RadioUrlError, which is a ValueError."""
    RadioUrl.parse(text)
    return text


def _wrong(text: str, forms: str) -> RadioUrlError:
    shown = text if len(text) <= 60 else text[:57] + "..."
    return RadioUrlError(f"'{shown}' is no radio; write {forms}")
