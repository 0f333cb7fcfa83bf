"""The page itself, made with viser. Knows no ROS: what is clicked becomes a request, what is shown is the core's."""
