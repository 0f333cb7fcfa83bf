"""A live connection for the Foxglove app: messages of a running graph, forwarded as they come. It takes none back."""
