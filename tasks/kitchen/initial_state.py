"""Initial qpos of the kitchen [rad, m], as the code of FrankaKitchen-v1 sets it (gymnasium-robotics 1.4.2).

Nine joints start slightly outside their ranges, and the kettle's quaternion is not normalised; both are kept.
"""

import numpy as np

from kitchen_suite.entities.scenes.kitchen import in_observed_order

_ARM = (0.148388023, -1.76848573, 1.84390296, -2.4768576, 0.260252026, 0.712533105, 1.59515394)
_FINGERS = (0.0479267505, 0.0371350919)

# By prop.
_OBJECTS = {
    "oven": (
        *(-0.00026627985, -5.18043486e-05),
        *(3.1287722e-05, -4.51199853e-05),
        *(-3.90842156e-06, -4.22629655e-05),
        *(6.28065475e-05, 4.04984708e-05),
    ),
    "hood": (0.000462730939, -0.000226906415),
    "slide_cabinet": (-0.000465501369,),
    "hinge_cabinet": (-0.00644129196, -0.00177048263),
    "microwave": (0.00108009684,),
    "kettle": (-0.26939744, 0.350383255, 1.61944683, 1.00618764, 0.0040639512, -0.00662095997, -0.000268278933),
}

INITIAL_QPOS = np.array([*_ARM, *_FINGERS, *in_observed_order(_OBJECTS)])
