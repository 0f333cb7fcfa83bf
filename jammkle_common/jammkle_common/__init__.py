"""What the nodes share: names, QoS, parameter tables, node runner, liveness, lockstep; bags; the command."""

VERSION = "0.1.0"
"""Of all packages: the one place. `make release` changes it; `make readme` carries it to each package.xml."""
