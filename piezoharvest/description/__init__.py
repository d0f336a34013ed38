"""What a user writes down: transducer, effects, shunts, excitation, and the words of their equations."""
