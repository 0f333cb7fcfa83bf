"""Materials of the tendon's fibres."""
