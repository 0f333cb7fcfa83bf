"""The board behind the driver: how it is wired, the line to it, and what is said on the line. Without ROS."""
