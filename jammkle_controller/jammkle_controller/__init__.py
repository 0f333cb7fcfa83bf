"""Slip and impact detection and the jamming policy of a jammable ankle."""
