"""Control modes that domains share: what the action means, as targets of the Franka's nine position servos.

| name                | action | module         |
|---------------------|--------|----------------|
| `joint_offset`      | 8      | `joints`       |
| `joint_position`    | 8      | `joints`       |
| `joint_delta`       | 8      | `joints`       |
| `ee_delta_position` | 4      | `end_effector` |
| `ee_delta_pose`     | 7      | `end_effector` |
| `ee_pose`           | 8      | `end_effector` |

The kitchen's own `joint_velocity` and `joint_position` are in `tasks.kitchen.control_modes`.
"""
