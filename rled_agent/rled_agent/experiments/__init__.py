"""Experiments as configuration: files that name commands, what makes their runs, and what is drawn of them."""
