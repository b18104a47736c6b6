"""The command line `mocha-link`: one module per command."""
