"""A door whose rooms are entered when one of their names is used (PEP 562).

A room's `__init__.py` names what other rooms may use. Where importing all of it would load what a
caller does not need (NumPy for a command's help, an extra that is not installed), it declares them
in one literal table, and `__init__.pyi` declares the same for type checkers:

    __getattr__, __dir__, __all__ = door(__name__, {"wire": ("Header", "HeaderError")})

Python 3.8 reads this file too: see `mocha_link.service.service_client`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module


def door(
    package: str, names: Mapping[str, Sequence[str]], modules: Sequence[str] = ()
) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """The `__getattr__`, `__dir__` and `__all__` of a package that loads its modules late.

    Args:
        package: its `__name__`.
        names: the public names of each module, the module by its path within the package.
        modules: modules that are public as they stand, as namespaces.
    """
    homes = {name: f"{package}.{path}" for path, found in names.items() for name in found}
    public = sorted({*homes, *modules})

    def attribute(name: str) -> object:
        if name in modules:
            return import_module(f"{package}.{name}")
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        found = getattr(import_module(homes[name]), name)
        setattr(sys.modules[package], name, found)  # the next time it is there
        return found

    def listing() -> list[str]:
        return sorted({*vars(sys.modules[package]), *public})

    return attribute, listing, public
