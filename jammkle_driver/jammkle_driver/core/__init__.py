"""What the driver decides, without ROS: channel states, requests, vacuum regulation."""
