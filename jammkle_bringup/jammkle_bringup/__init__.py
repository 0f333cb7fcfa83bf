"""The jammkle command and what brings the graph up."""
