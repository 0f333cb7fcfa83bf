"""The sim-to-real gap: where simulation and robot disagree, which effect explains it, how far the gap shrinks.

Nothing here knows of the ankle, of ROS or of MuJoCo, but for the package `ankle`, which is its first user: give
recordings, a simulator (any callable) and effects, and get a diagnosis.
"""
