"""The judge of rehearsed flights. It shares no code with what it judges."""
