"""Edits mission files on a map: the text stays as it is, but for the values that were changed."""
