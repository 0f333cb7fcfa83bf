"""What the controller decides, without ROS: contact detection and the jamming policy."""
