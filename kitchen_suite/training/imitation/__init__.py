"""Learning from demonstrations, in chunks of actions: behaviour cloning, flow matching, VQ-BeT."""
