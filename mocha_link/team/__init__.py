"""The configuration that all robots share: who they are, what they say, their keys."""
