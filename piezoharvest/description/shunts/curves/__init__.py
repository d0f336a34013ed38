"""Parts whose voltage is no multiple of their current: a broken line over it, or what lags, and circuits with both."""
