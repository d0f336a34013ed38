"""Description of a system by its user: transducer, effects, shunts, excitation, and the terms of their equations."""
