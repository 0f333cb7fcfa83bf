"""The gap monitor's node: follows a robot with a simulated twin and says when the robot leaves it."""
