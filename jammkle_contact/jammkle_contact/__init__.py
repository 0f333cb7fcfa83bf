"""Driver, controller and simulation in one process: detection on recordings, and the trial of contact."""
