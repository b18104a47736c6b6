"""The figures of an experiment. Needs matplotlib."""
