"""Effects in the mechanics of the specimen."""
