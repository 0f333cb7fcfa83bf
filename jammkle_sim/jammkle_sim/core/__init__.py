"""What the sim node decides, without ROS: pacing, publishing schedule, pause and step."""
