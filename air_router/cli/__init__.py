"""The command line `air-router`: one module per command."""
