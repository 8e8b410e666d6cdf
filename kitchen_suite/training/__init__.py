"""Training of policies by PPO on the vectorised environments; needs the extra `train`."""
