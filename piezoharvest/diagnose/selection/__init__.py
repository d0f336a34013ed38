"""Stepwise selection of effects: score tests, full fits of models that differ in their effects, significance."""
