"""`python -m jammkle_bringup`: the jammkle command."""

import sys

from jammkle_bringup.command import main

if __name__ == "__main__":
    sys.exit(main())
