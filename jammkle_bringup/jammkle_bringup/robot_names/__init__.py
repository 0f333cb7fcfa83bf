"""A node that calls joints and channels as the robot does."""
