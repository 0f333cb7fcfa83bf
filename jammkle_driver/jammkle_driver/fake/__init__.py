"""Hardware in process: a small plant of pump, manifold and channels, with faults by script."""
