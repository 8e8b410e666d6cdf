"""Training of policies by PPO on the vectorised environments, or by imitation; needs the extra `train`."""
