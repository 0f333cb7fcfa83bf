"""The `jammkle` command and what its verbs share. The verbs are each package's own, named by entry points."""
