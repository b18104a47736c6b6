"""What another user has put in the way."""

import os
from pathlib import Path

ANOTHER = 12_345  # a user id


def foreign_link(link: Path, to: Path, monkeypatch) -> None:
    """A link of another user; without the rights to make one, we are another user from now on."""
    link.symlink_to(to)
    if os.getuid() == 0:
        os.lchown(link, ANOTHER, ANOTHER)
    else:
        monkeypatch.setattr(os, "getuid", lambda: ANOTHER)
