"""A diagnosis for people: words, figures, a page of sections, and what the terminal shows. Does not import rclpy."""
