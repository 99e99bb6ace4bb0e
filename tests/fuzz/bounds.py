"""What one input may cost."""

SECONDS = 5.0
"""Of work or of waiting for something; a process that could work and is not scheduled does not hang."""
MEMORY = 512 << 20
"""Bytes of resident memory more than before."""
ADDRESSES = 3 << 30
"""Bytes of address space more than before; no input gets more, so that none takes the machine's memory."""
FILES = 256 << 20
"""Bytes of a file that is written."""
INPUT = 1 << 20
"""Bytes of an input."""
