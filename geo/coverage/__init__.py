"""Rows over an area, and the order in which they are flown."""
