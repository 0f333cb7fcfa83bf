"""Rigs that load the ankle: what is held, dropped or pulled, and where. Built on the physics."""
