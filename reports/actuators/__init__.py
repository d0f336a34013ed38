"""Two measured actuators: loops of a stack, frequency responses of a mirror; page in `index.html`."""
