"""Training of policies with skrl's PPO on the vectorised environments; needs the extra `train`."""
