"""Prediction of records behind circuits with diodes and switches, by the event-driven engine."""
