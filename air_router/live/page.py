"""Whether flights are shown on a live page, and where; `air_router.live` is the page itself."""

import argparse
from collections.abc import Collection, Iterable
from contextlib import AbstractAsyncContextManager, nullcontext
from typing import Any, Protocol

from air_router.controller.model.actions import Action
from air_router.controller.model.events import Event
from air_router.web.serving import (
    DEFAULT_PORT,
    PageAddress,
    Say,
    Served,
    Web,
    add_page_options,
    page_port,
)
from mocha_link.errors import needs_extra


class Page(Served, Protocol):
    """Shows a flight while it lasts."""

    def step(self, event: Event, actions: Collection[Action], now_s: float) -> None:
        """Take in what happened, and what was decided on it."""


class SharedPage(Served, Protocol):
    """A page for several flights."""

    def found(self, name: str, address: PageAddress) -> None:
        """A flight's page is there; may be called from any thread."""


class NoPage:
    """The page of a flight that is not shown."""

    def step(self, event: Event, actions: Collection[Action], now_s: float) -> None:
        """No page is open."""

    def serving(self, say: Say) -> AbstractAsyncContextManager[object]:
        """Nothing is served."""
        del say
        return nullcontext()


def add_web(parser: argparse.ArgumentParser, *, always: bool = False) -> None:
    """Add `--web` and what belongs to it; `always`: a page is what the command is for."""
    asked: dict[str, Any] = {"nargs": "?", "const": DEFAULT_PORT}
    parser.add_argument(
        "--web",
        type=page_port,
        metavar="PORT",
        help=f"{'serve the page' if always else 'show the flight on a map page'} there "
        f"(default port {DEFAULT_PORT}, 0: any free one)",
        **({"default": DEFAULT_PORT} if always else asked),
    )
    add_page_options(parser, "web-")


def joint_page(names: Iterable[str], web: Web) -> SharedPage:
    """One page for several flights.

    Raises:
        UsageError: what serves pages is not installed.
    """
    with needs_extra("the page", "web", "air-router"):
        from air_router.live.joint import JointPage  # noqa: PLC0415 - an extra
    return JointPage(names, web)
