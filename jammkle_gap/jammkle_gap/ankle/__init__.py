"""The diagnosis's first user: recordings of an ankle from bags, the rigs as simulators, the library of its effects."""
