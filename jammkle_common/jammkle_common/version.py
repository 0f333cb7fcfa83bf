"""Version of all packages: the one place. `make release` changes it; `make readme` carries it to each package.xml."""

VERSION = "0.1.0"
