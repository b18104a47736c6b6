"""Survey lines over an area, from files and for cameras."""
