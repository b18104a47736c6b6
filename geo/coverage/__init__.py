"""Rows over an area, and the order in which they are flown."""

from geo.coverage.coverage import Coverage, CoverageError, Swath, UnseenCause, cover

__all__ = [
    "Coverage",
    "CoverageError",
    "Swath",
    "UnseenCause",
    "cover",
]
