"""The paper beside the simulation: what is run, how it is compared, what is drawn. Does not import rclpy."""
