"""From a system and an excitation to the matrices of its linear modes."""
