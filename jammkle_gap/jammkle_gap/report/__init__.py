"""A diagnosis for people: words, tables, curves, the page, and where its runs happen. Does not import rclpy."""
