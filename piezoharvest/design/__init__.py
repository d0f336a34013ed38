"""Choice of the shunt: optimal loads and tuning."""
