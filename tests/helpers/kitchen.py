"""The kitchen domain: constants of the original environment, which tests compare with."""

import numpy as np

# Bounds of the robot's position targets [rad, m].
POSITION_LOW = np.array([-2.9, -1.8, -2.9, -3.1, -2.9, 0.0, -2.9, 0.0, 0.0])
POSITION_HIGH = np.array([2.9, 1.8, 2.9, 0.0, 2.9, 3.8, 2.9, 0.04, 0.04])
