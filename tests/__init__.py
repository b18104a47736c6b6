"""The tests, room by room as in the packages.

A package, since a library of the benchmarks installs a `tests` of its own.
"""
