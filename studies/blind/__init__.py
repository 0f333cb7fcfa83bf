"""Blind trials of the gap diagnosis: what is put in, what was said, how good that is. No ROS in here."""
