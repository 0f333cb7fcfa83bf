"""Bags of this project: written with their message definitions, and read, or refused in one line."""
