"""How good the diagnosis of any robot is, on machines whose truth is withheld from it."""
