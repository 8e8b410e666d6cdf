"""The pictures of the scenes on these pages; rendering needs a GL library."""

from pathlib import Path

import numpy as np
from dm_control import mjcf
from PIL import Image

from kitchen_suite import suite
from kitchen_suite.entities.joints import addresses
from kitchen_suite.rendering.cameras import camera_names
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS
from kitchen_suite.tasks.microwave_table.task import GOAL
from kitchen_suite.tasks.observables import DEFAULT_SIZE
from kitchen_suite.tasks.open_cabinet.task import DEFAULT_POSE

DOCS = Path(__file__).parent
PICTURE_HEIGHT, PICTURE_WIDTH = 480, 640
# Pictures are rendered larger by this factor, and reduced: edges of shadows are not smoothed otherwise.
SMOOTHING = 2
# Joint positions of the robot [rad, m] and opening of the top drawer [m]: initial state, grasp, open drawer.
CABINET_STATES = (
    (DEFAULT_POSE, 0.0),
    ((0, 0.064, 0, -1.899, 0, 3.534, -0.785, 0.006, 0.006), 0.0),
    ((0, -1.187, 0, -2.862, 0, 3.246, -0.785, 0.006, 0.006), 0.358),
)


def write_pictures() -> None:
    """Renders the pictures of all domains."""
    write_kitchen_pictures()
    write_cabinet_picture()
    write_microwave_picture()
    write_camera_sheets()
    write_goal_sheet()


def write_cabinet_picture() -> None:
    """Renders the initial state, the grasp and the open drawer from every camera of open_cabinet."""
    environment = suite.load("open_cabinet", "top_drawer", {"random": 0})
    environment.reset()
    columns = []
    for pose, opening in CABINET_STATES:
        with environment.physics.reset_context():
            environment.physics.bind(environment.task.scene.robot.joints).qpos = pose
            environment.physics.bind(environment.task.scene.cabinet.drawer_joint("top")).qpos = opening
        cameras = ("overview", "handle", "franka/wrist")
        columns.append(np.vstack([smooth_picture(environment.physics, camera, 300, 400) for camera in cameras]))
    save_photograph(np.hstack(columns), "open_cabinet")


def write_microwave_picture() -> None:
    """Renders microwave_table at the start of an episode from two cameras, and with the door open."""
    environment = suite.load("microwave_table", "open", {"random": 0})
    environment.reset()
    physics, door = environment.physics, environment.task.scene.joints("microwave")
    columns = [smooth_picture(physics, camera, 300, 400) for camera in ("overview", "franka/wrist")]
    pose = physics.bind(environment.task.robot.joints).qpos.copy()
    with physics.reset_context():
        physics.bind(environment.task.robot.joints).qpos = pose
        physics.bind(door).qpos = GOAL.value
    columns.append(smooth_picture(physics, "overview", 300, 400))
    save_photograph(np.hstack(columns), "microwave_table")


def write_kitchen_pictures() -> None:
    """Renders the kitchen at the start of an episode."""
    environment = suite.load("kitchen", "all", {"random": 0})
    environment.reset()
    for name in camera_names(environment.physics):
        picture = smooth_picture(environment.physics, name, PICTURE_HEIGHT, PICTURE_WIDTH)
        save_photograph(picture, f"kitchen_{name.replace('/', '_')}")
    # The picture that the page opens with.
    save_photograph(smooth_picture(environment.physics, "overview", 720, 960), "kitchen_overview")
    sheet = [
        smooth_picture(environment.physics, "overview", PICTURE_HEIGHT, PICTURE_WIDTH),
        depth_picture(environment.physics.render(PICTURE_HEIGHT, PICTURE_WIDTH, camera_id="overview", depth=True)),
        class_picture(environment.physics.render(PICTURE_HEIGHT, PICTURE_WIDTH, "overview", segmentation=True)),
    ]
    Image.fromarray(np.hstack(sheet)).save(DOCS / "pictures" / "kitchen_rgb_depth_segmentation.png", optimize=True)


def smooth_picture(physics: mjcf.Physics, camera: str, height: int, width: int) -> np.ndarray:
    """Returns a picture of a camera with smooth edges."""
    picture = physics.render(SMOOTHING * height, SMOOTHING * width, camera_id=camera)
    return np.array(Image.fromarray(picture).reduce(SMOOTHING))


def save_photograph(picture: np.ndarray, name: str) -> None:
    """Writes a picture as a JPEG file."""
    Image.fromarray(picture).save(DOCS / "pictures" / f"{name}.jpg", quality=90, optimize=True)


def depth_picture(depth: np.ndarray) -> np.ndarray:
    """Returns depth [m] as shades of grey: white at 1 m, black at 4 m."""
    shade = np.clip((4.0 - depth) / 3.0, 0.0, 1.0) * 255
    return np.repeat(shade.astype(np.uint8)[..., None], 3, axis=2)


def class_picture(segmentation: np.ndarray) -> np.ndarray:
    """Returns a segmentation with a colour for each geom."""
    colours = np.random.default_rng(1).integers(40, 256, (segmentation[..., 0].max() + 2, 3), dtype=np.uint8)
    colours[-1] = 0
    return colours[segmentation[..., 0]]


def write_camera_sheets() -> None:
    """Renders each domain from the cameras for learning, as small as agents see it."""
    for domain in suite.DOMAINS:
        environment = suite.load(domain, suite.default_task(domain), {"random": 0})
        environment.reset()
        names = [name for name in camera_names(environment.physics) if not name.endswith("_cap")]
        save_sheet([small_picture(environment.physics, name) for name in names], f"cameras_{domain}")


def write_goal_sheet() -> None:
    """Renders the kitchen before and after each default task from `workspace`, as small as agents see it."""
    environment = suite.load("kitchen", "all", {"random": 0})
    environment.reset()
    physics = environment.physics
    state, pictures = physics.get_state(), [small_picture(physics, "workspace")]
    for goal in (GOALS[task] for task in DEFAULT_TASKS):
        with physics.reset_context():
            physics.set_state(state)
            qpos, _ = addresses(physics, goal.joints_in(environment.task.scene))
            physics.data.qpos[qpos] = goal.value
        pictures.append(small_picture(physics, "workspace"))
    save_sheet(pictures, "workspace_goals")


def small_picture(physics: mjcf.Physics, camera: str) -> np.ndarray:
    """Returns a picture of 128 x 128 pixels, each as two by two."""
    return physics.render(*DEFAULT_SIZE, camera_id=camera).repeat(2, axis=0).repeat(2, axis=1)


def save_sheet(pictures: list[np.ndarray], name: str) -> None:
    """Writes pictures in rows of four."""
    gap = np.full_like(pictures[0], 255)
    rows = [pictures[i : i + 4] for i in range(0, len(pictures), 4)]
    width = len(rows[0])
    sheet = np.vstack([np.hstack([*row, *[gap] * (width - len(row))]) for row in rows])
    Image.fromarray(sheet).save(DOCS / "pictures" / f"{name}.png", optimize=True)
