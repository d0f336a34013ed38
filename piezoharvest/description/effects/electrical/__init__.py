"""Effects in the electrical domain of the specimen and in its coupling."""
