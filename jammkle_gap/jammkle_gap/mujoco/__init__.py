"""The gap of any robot that MuJoCo can simulate: a model, recordings, and what differs."""
