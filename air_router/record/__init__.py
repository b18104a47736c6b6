"""The record of a flight: written, read, and run again."""
