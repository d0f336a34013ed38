"""Circuits that charge a load through a rectifier or a switch."""
