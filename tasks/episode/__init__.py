"""The life of an episode, written once: its state, its optional parts, and the order of resets and control steps."""
