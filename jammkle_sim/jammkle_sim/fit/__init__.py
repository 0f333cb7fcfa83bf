"""The fit of the tendon's constants to the paper, the check against the reference model, and what it all says."""
