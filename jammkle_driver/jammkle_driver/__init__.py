"""Pump and solenoids of a jammable ankle as topics and services."""
