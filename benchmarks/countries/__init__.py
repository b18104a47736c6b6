"""Airspaces and geozones of whole countries, read twice: by our reader, and by one of its own."""
