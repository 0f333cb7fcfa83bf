"""A recording played back, with its simulation laid over it."""
