"""Simulated and real vehicles as processes, started, paced and ended for certain."""
