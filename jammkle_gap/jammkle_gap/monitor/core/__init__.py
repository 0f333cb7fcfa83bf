"""The gap while the robot runs: its subsystems simulated beside it, sample by sample. Does not import rclpy."""
