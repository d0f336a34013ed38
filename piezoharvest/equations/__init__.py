"""Equations of a described transducer and its effects, for all views of it."""
