"""Physics of the ankle: tendon, pneumatics, rigid bodies, sensors. Knows nothing of rigs or ROS."""
