"""Shortest clear paths between places, without a graph."""
