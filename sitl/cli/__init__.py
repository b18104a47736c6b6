"""The command line `sitl`: one module per command."""
