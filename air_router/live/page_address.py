"""The address of a flight's page, as `fly --web` prints it and `watch` takes it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qs, urlsplit

from air_router.errors import UsageError

SHOWN_AT: Final = "the flight is shown at "
"""What a flight says before its page's address."""

DEFAULT_PORT: Final = 8425


@dataclass(frozen=True, slots=True)
class PageAddress:
    """The address of a flight's page.

    Attributes:
        host: A name or an IP address, as URLs have it.
        port: Where it is served.
        token: What the page asks for; None if only its own machine reaches it.
    """

    host: str
    port: int
    token: str | None = None

    @classmethod
    def of(cls, text: str) -> PageAddress:
        """Read http://HOST:PORT/?token=..., or HOST, or HOST:PORT.

        Raises:
            UsageError: it is none.
        """
        whole = text if "://" in text else f"http://{text}"
        try:
            parts = urlsplit(whole)
            host, port = parts.hostname, parts.port
        except ValueError:
            host = port = None
        if not host or parts.scheme != "http" or parts.path not in {"", "/"}:
            raise UsageError(
                f"'{text}' is not the address of a flight's page; give what `fly --web` prints, "
                "http://HOST:PORT/"
            )
        if port is None:
            port = 80 if whole == text else DEFAULT_PORT
        (token,) = parse_qs(parts.query).get("token", [None])[:1]
        return cls(f"[{host}]" if ":" in host else host, port, token)

    @classmethod
    def heard(cls, line: str) -> PageAddress | None:
        """The address in a line that a flight printed; None if there is none."""
        _, _, address = line.partition(SHOWN_AT)
        with suppress(UsageError):
            return cls.of(address.strip())
        return None

    @property
    def place(self) -> str:
        """Where it is, without what is secret: "127.0.0.1:8425"."""
        return f"{self.host}:{self.port}"

    @property
    def socket(self) -> str:
        """Where its page's socket is."""
        return f"http://{self.place}/socket"
