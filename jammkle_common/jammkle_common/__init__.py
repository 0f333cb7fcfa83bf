"""Shared by every Jammkle node: names on the graph, QoS, parameter tables, diagnostics, and how a node runs."""
