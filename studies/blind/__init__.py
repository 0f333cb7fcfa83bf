"""The blind trial of the diagnosis, and the second simulator that it is tried on."""
