"""What a PX4 reports in EVENT messages, in words that an operator can act on."""
