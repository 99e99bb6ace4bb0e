"""Updates of networks from transitions."""
