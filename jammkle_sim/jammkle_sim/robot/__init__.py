"""The sim node of a leg or a quadruped: `python -m jammkle_sim.robot`."""
