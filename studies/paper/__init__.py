"""The paper beside the simulation: its tables and figures, and the fit of the tendon's constants to it."""
