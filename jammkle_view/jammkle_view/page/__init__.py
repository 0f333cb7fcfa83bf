"""The page itself, made with viser. Knows no ROS: what is clicked becomes a wish, what is shown comes from the core."""
