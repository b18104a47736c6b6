"""QGroundControl plans: read, edited in place, and written."""
