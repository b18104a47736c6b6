"""The port through which a flight sees and commands its vehicle."""
