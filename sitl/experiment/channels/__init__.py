"""Radio channels, one model each behind one port."""
