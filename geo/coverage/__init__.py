"""Survey rows over an area, and their order."""

from geo.coverage.coverage import Coverage, CoverageError, Swath, UnseenCause, cover

__all__ = [
    "Coverage",
    "CoverageError",
    "Swath",
    "UnseenCause",
    "cover",
]
