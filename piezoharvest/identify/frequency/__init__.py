"""Frequency responses and impedances: their noise, their resonances, and fits of modes."""
