"""Whether a tag may be released, and its notes: `python packaging/release.py v0.2.0 NOTES.md`.

The tag names the version of the sources, and CHANGELOG.md has a dated section for it, which becomes
the notes. Exit code 1: one of these does not hold; the message says which.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


class NotReleasableError(Exception):
    """The sources are not those of the tag; the message says why."""


def version_of(sources: str) -> str:
    """The version in `mocha_link/__init__.py`, which both distributions have."""
    found = re.search(r'^__version__ = "([^"]+)"$', sources, re.MULTILINE)
    if found is None:
        raise NotReleasableError("mocha_link/__init__.py has no __version__")
    return found[1]


def notes(changelog: str, version: str) -> str:
    """The dated section of a version. Raises NotReleasableError: there is none."""
    pattern = rf"^## \[{re.escape(version)}\] - (\S+)\n(.*?)(?=^## |\Z)"
    found = re.search(pattern, changelog, re.MULTILINE | re.DOTALL)
    if found is None:
        raise NotReleasableError(f"CHANGELOG.md has no section '## [{version}] - DATE'")
    if not re.fullmatch(r"\d{4}-\d{2}-\d{2}", found[1]):
        raise NotReleasableError(f"CHANGELOG.md: {version} has no date, but '{found[1]}'")
    return found[2].strip() + "\n"


def release(tag: str, sources: str, changelog: str) -> str:
    """The notes of a tag. Raises NotReleasableError."""
    version = version_of(sources)
    if tag != f"v{version}":
        raise NotReleasableError(f"the tag is {tag}, but the sources are version {version}")
    return notes(changelog, version)


def main(tag: str, target: str) -> None:
    """Write the notes of a tag into a file."""
    sources = (ROOT / "mocha_link" / "__init__.py").read_text(encoding="utf-8")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    Path(target).write_text(release(tag, sources, changelog), encoding="utf-8")


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except NotReleasableError as error:
        sys.exit(f"{error}")
    except TypeError:
        sys.exit("usage: python packaging/release.py TAG NOTES_FILE")
