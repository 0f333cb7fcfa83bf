"""What bringup does without ROS: process supervision, bags, summaries, pictures."""
