"""What data files tell of themselves and of the specimen, before a campaign says anything about them."""
