"""The updates: TD3 with DDPG as a case of it, and behavioural cloning."""
