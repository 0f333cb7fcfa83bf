"""The diagnosis itself: one whitened likelihood over recordings, a simulator and a library of effects.

It knows of no ankle and of no ROS. See `jammkle_gap` for the names that are public.
"""
