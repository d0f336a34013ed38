"""Effects in the circuit behind the electrodes: its switch, its loop, its diodes, and the meters on it."""
