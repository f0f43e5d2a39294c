"""Training of the segment descriptor."""
