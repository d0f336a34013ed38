"""Harvesting circuits with a capacitor between two switched converters, one file each."""
