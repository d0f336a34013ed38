"""Parts that can be bought: preferred values, joint rounding, and the worst case within their tolerance."""
