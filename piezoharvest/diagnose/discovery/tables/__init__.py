"""Tables of a law: the inputs that records visit, corners among them, and how smooth the curve is."""
