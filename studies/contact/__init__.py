"""The trial of detectors and policy, and what the ankle is worth on simulated robots."""
