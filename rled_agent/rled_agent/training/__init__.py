"""The training loop, its runs on disk, and how good what it learned is."""
