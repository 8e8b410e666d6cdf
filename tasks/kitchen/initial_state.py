"""How an episode in the kitchen starts: every number of qpos, in the order of the observation [rad, m].

What the code of FrankaKitchen-v1 sets (gymnasium-robotics 1.4.2). Nine joints lie a little outside their ranges and the
kettle's quaternion is not normalised; both stay as they are.
"""

import numpy as np

_ARM = (0.148388023, -1.76848573, 1.84390296, -2.4768576, 0.260252026, 0.712533105, 1.59515394)
_FINGERS = (0.0479267505, 0.0371350919)
_KNOBS_AND_BURNERS = (
    *(-0.00026627985, -5.18043486e-05),
    *(3.1287722e-05, -4.51199853e-05),
    *(-3.90842156e-06, -4.22629655e-05),
    *(6.28065475e-05, 4.04984708e-05),
)
_LIGHT = (0.000462730939, -0.000226906415)
_SLIDE_CABINET = (-0.000465501369,)
_HINGE_CABINET = (-0.00644129196, -0.00177048263)
_MICROWAVE = (0.00108009684,)
_KETTLE = (-0.26939744, 0.350383255, 1.61944683, 1.00618764, 0.0040639512, -0.00662095997, -0.000268278933)

INITIAL_QPOS = np.array(
    [*_ARM, *_FINGERS, *_KNOBS_AND_BURNERS, *_LIGHT, *_SLIDE_CABINET, *_HINGE_CABINET, *_MICROWAVE, *_KETTLE]
)
