"""Measurements: `make bench-goals`, `bench-link`, `bench-route`; never asserted in tests."""
