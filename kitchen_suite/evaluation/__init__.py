"""Evaluation of policies under protocols: the episodes, their scores, and what is kept of them."""
