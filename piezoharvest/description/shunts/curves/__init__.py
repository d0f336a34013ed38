"""Parts whose voltage over their current is a broken line: the curve, and circuits with such parts."""
