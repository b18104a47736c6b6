"""What the vehicle flies in a state of the mission, and what it does on the way."""

from __future__ import annotations

from typing import Final, Protocol


class StateHandler(Protocol):
    """Asked while its state lasts, and never in another; how it begins, each has its own way."""

    def arrived(self) -> None:
        """The vehicle is where it was sent; said again as long as it stays there."""

    def no_route(self, refusal: str) -> None:
        """No clear way leads there from here, and why."""

    def retry(self) -> None:
        """The pause is over after something that could not be done."""

    def replan(self) -> None:
        """Other zones count from now on, and nothing was commanded meanwhile: plan anew."""


class NoHandler:
    """That of states in which the vehicle is on the ground, or not ours to command."""

    def arrived(self) -> None:
        """Nothing."""

    def no_route(self, refusal: str) -> None:
        """Nothing."""

    def retry(self) -> None:
        """Nothing."""

    def replan(self) -> None:
        """Nothing."""


NO_HANDLER: Final = NoHandler()
