"""The driver's diagnosis, judged: random faults, healthy ankles, and soaks."""
