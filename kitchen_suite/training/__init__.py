"""Training of policies by skrl's PPO on the vectorised environments. It needs the extra `train`."""
