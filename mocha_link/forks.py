"""What a forked child must leave alone: its parent's nodes, clients and servers.

After `os.fork` (the default of multiprocessing on Linux before Python 3.14) the child has copies of
them without their threads, with locks that nobody will release, and with the parent's ports and
files open. So in the child every method raises `ForkedError` at once, and the sockets are closed.

Python 3.8 reads this file too: see `mocha_link.service.service_client`.
"""

from __future__ import annotations

import contextlib
import os
import weakref
from typing import Any, TypeVar

from mocha_link.errors import MochaLinkError

_Any = TypeVar("_Any")

# Objects that a child must not use, and what the error calls them.
_owners: weakref.WeakKeyDictionary[Any, str] = weakref.WeakKeyDictionary()
_open: weakref.WeakSet[Any] = weakref.WeakSet()  # sockets and pollers that a child closes


class ForkedError(MochaLinkError):
    """A forked child used an object of its parent, e.g. a node."""


def parents_only(owner: _Any, name: str = "") -> _Any:
    """Make an object unusable in forked children.

    Args:
        owner: the object; a plain class instance. Everything that only it holds stays as it is in
            the child, and is never finalized there: an SQLite file, for example, would be cleaned
            up under the parent.
        name: what the error calls it; default: its class.

    Returns:
        The object.
    """
    _owners[owner] = name or type(owner).__name__
    return owner


def closed_in_children(resource: _Any) -> _Any:
    """Have forked children close a socket or a selector.

    Args:
        resource: has a `close` that only gives up this process's descriptor.

    Returns:
        The resource.
    """
    _open.add(resource)
    return resource


class _Forked:
    """In a child these methods come before those of an object's class: most raise ForkedError."""

    def __del__(self) -> None:
        pass  # the parent closes it

    def __getattribute__(self, name: str) -> Any:
        if name.startswith("__"):
            return object.__getattribute__(self, name)
        if name == "close":  # nothing is left to close
            return _nothing
        raise _error_of(self)

    def __enter__(self) -> None:
        raise _error_of(self)

    def __exit__(self, *_: object) -> None:
        pass  # the block may end by `sys.exit`

    def __aiter__(self) -> None:
        raise _error_of(self)

    async def __aenter__(self) -> None:
        raise _error_of(self)

    async def __aexit__(self, *_: object) -> None:
        pass

    async def __anext__(self) -> None:
        raise _error_of(self)


def _error_of(forked: _Forked) -> ForkedError:
    name = type(forked).__name__
    return ForkedError(
        f"this {name} belongs to the process that made it, and this is a forked child; make a "
        f"{name} here, or start the child without a fork: multiprocessing's method 'spawn'"
    )


def _nothing() -> None:
    pass


def _forked() -> None:
    """Run in a child, right after the fork, on its only thread: takes no lock."""
    for resource in list(_open):
        with contextlib.suppress(OSError, ValueError):  # closed already
            resource.close()
    _open.clear()
    owners = list(_owners.items())
    _owners.clear()
    for owner, name in owners:
        kind: Any = type(owner)
        methods = {key: each for key, each in vars(_Forked).items() if callable(each)}
        make: Any = type(kind)
        owner.__class__ = make(name, (kind,), {"__slots__": (), **methods})
    if owners:
        import ctypes  # noqa: PLC0415 - no process needs it before

        # A reference that nobody gives back. At the child's end no finalizer runs.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(owners))


os.register_at_fork(after_in_child=_forked)
