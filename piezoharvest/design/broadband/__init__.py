"""Expected figures under noise: exact for linear shunts, estimated with a standard error for switched ones."""
