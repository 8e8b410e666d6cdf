"""Offline reinforcement learning: from recorded episodes with their rewards, whether they succeeded or not."""
