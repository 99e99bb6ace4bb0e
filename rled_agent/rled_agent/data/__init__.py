"""What is learned from: transitions, and demonstrations read from bags."""
