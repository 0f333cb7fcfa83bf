"""Simulation of a jammable ankle, its pneumatics, rigs and sensors in MuJoCo."""
