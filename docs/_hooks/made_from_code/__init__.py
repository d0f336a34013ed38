"""What of the documentation is made from the code: pages of the reference, and schemas for editors."""
