"""Mission files in YAML: their form, read and written."""
