"""PX4's flight modes, one object each."""
