"""Makes the pictures of the scenes on the pages, in docs/pictures/.

python docs/scripts/pictures.py            all domains from every camera, and varied scenes; needs a GL library
python docs/scripts/pictures.py kitchens   generated kitchens alone
python docs/scripts/pictures.py objects    generated kitchens with objects alone
python docs/scripts/pictures.py grammar    what generated kitchens are drawn from; needs the extra `docs` as well
python docs/scripts/pictures.py controls   plots and frames of the control modes; needs the extra `docs` as well
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import gymnasium
import mujoco
import numpy as np
import tracking
from dm_control import mjcf
from dm_control.mujoco import wrapper
from dm_control.mujoco.engine import MovableCamera
from experiment import PICTURES, make_parser
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from kitchen_suite import suite
from kitchen_suite.entities.fixture_designs import HANDLES
from kitchen_suite.entities.joints import addresses
from kitchen_suite.entities.kitchen_styles import STYLES
from kitchen_suite.environment import Environment
from kitchen_suite.rendering.cameras import camera_names
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS, rotations
from kitchen_suite.tasks.control_modes.joints import DEFAULT_POSE
from kitchen_suite.tasks.microwave_table.task import GOAL
from kitchen_suite.tasks.pictures import DEFAULT_SIZE
from kitchen_suite.tasks.variations.distributions import SPLITS

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
    write_kitchens_sheet()
    write_objects_sheet()
    write_camera_sheets()
    write_goal_sheet()
    write_variation_sheets()
    write_quality_picture()


def write_quality_picture() -> None:
    """Renders the kitchen in the qualities `high` and `fast`, side by side, as Gymnasium's `render()` shows it."""
    images = []
    for quality in ("high", "fast"):
        env = gymnasium.make(
            "kitchen_suite:KitchenSuite/Kettle-v1",
            render_mode="rgb_array",
            width=PICTURE_WIDTH,
            height=PICTURE_HEIGHT,
            render_quality=quality,
        )
        env.reset(seed=0)
        images.append(env.render())
        env.close()
    save_photograph(np.hstack(images), "render_quality")


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


def write_kitchens_sheet() -> None:
    """Renders the first 64 generated kitchens of the split `train`, in rows of eight, at the start of an episode."""
    save_kitchens("kitchens", 64, columns=8, camera="overview", width=200)


def write_objects_sheet() -> None:
    """Renders the first 20 generated kitchens with objects, from nearer than those without: objects are small."""
    save_kitchens("pick_and_place", 20, columns=5, camera="workspace", width=320)


def save_kitchens(domain: str, count: int, *, columns: int, camera: str, width: int) -> None:
    """Writes pictures of the first generated kitchens of a domain, of a width [pixels], in rows."""
    pictures = []
    for design in range(count):
        environment = suite.load(domain, "any", {"random": 0, "design": design})
        environment.reset()
        pictures.append(smooth_picture(environment.physics, camera, 3 * width // 4, width))
    sheet = np.vstack([np.hstack(pictures[i : i + columns]) for i in range(0, len(pictures), columns)])
    Image.fromarray(sheet).save(PICTURES / f"{domain}.webp", quality=80)


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
    Image.fromarray(np.hstack(sheet)).save(PICTURES / "kitchen_rgb_depth_segmentation.png", optimize=True)


def smooth_picture(physics: mjcf.Physics, camera: str, height: int, width: int) -> np.ndarray:
    """Returns a picture of a camera with smooth edges."""
    return reduced(physics.render(SMOOTHING * height, SMOOTHING * width, camera_id=camera))


def reduced(picture: np.ndarray) -> np.ndarray:
    """Returns a picture that was rendered larger by the factor `SMOOTHING`, at its size."""
    return np.array(Image.fromarray(picture).reduce(SMOOTHING))


def save_photograph(picture: np.ndarray, name: str) -> None:
    """Writes a picture as a JPEG file."""
    Image.fromarray(picture).save(PICTURES / f"{name}.jpg", quality=90, optimize=True)


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
    Image.fromarray(sheet).save(PICTURES / f"{name}.png", optimize=True)


SHEET_HEIGHT, SHEET_WIDTH = 180, 240
# Groups that pictures show.
GROUPS = ("start", "layout", "appearance", "camera")

LABEL_WIDTH = 110


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sheet:
    """A picture with one row for each split and camera.

    Attributes:
      domain: of the scenes.
      task: of the episodes.
      cameras: of the rows of each split.
      columns: scenes in a row.
    """

    domain: str
    task: str
    cameras: Sequence[str]
    columns: int


SHEETS = (
    Sheet(domain="kitchen", task="complete", cameras=("overview", "workspace"), columns=6),
    Sheet(domain="open_cabinet", task="top_drawer", cameras=("overview",), columns=4),
)


def write_variation_sheets() -> None:
    """Renders another scene for each place of each sheet."""
    for sheet in SHEETS:
        rows = [row for split in SPLITS for row in variation_rows(sheet, split)]
        path = PICTURES / f"variations_{sheet.domain}.jpg"
        Image.fromarray(np.vstack(rows)).save(path, quality=88, optimize=True)


def variation_rows(sheet: Sheet, split: str) -> list[NDArray[np.uint8]]:
    """Returns a row of pictures for each camera of a sheet."""
    options = {"random": 0, "variations": GROUPS, "variation_split": split}
    environment = suite.load(sheet.domain, sheet.task, options)
    return [
        np.hstack(
            [
                label_picture(f"{split.replace('_', ' ')},\n{camera}"),
                *start_pictures(environment, camera, sheet.columns),
            ]
        )
        for camera in sheet.cameras
    ]


def start_pictures(environment: Environment, camera: str, count: int) -> list[NDArray[np.uint8]]:
    """Returns pictures `(SHEET_HEIGHT, SHEET_WIDTH, 3)` of the starts of the next episodes."""
    pictures = []
    for _ in range(count):
        environment.reset()
        pictures.append(environment.physics.render(SHEET_HEIGHT, SHEET_WIDTH, camera_id=camera))
    return pictures


def label_picture(text: str) -> NDArray[np.uint8]:
    """Returns a text as a picture, for the head of a row."""
    image = Image.new("RGB", (LABEL_WIDTH, SHEET_HEIGHT), "white")
    ImageDraw.Draw(image).multiline_text((8, SHEET_HEIGHT // 2 - 16), text, fill="black", font_size=15)
    return np.array(image)


AXES = "xyz"
# Red, green and blue for x, y and z.
COLOURS = ((0.9, 0.1, 0.1, 1.0), (0.1, 0.7, 0.1, 1.0), (0.1, 0.2, 0.9, 1.0))


def write_control_pictures() -> None:
    """Writes the plot of the lines, and the picture of the frames."""
    draw_lines()
    render_frames()


def draw_lines() -> None:
    """Plots the end effector's way along the axes of the base, and its distance from the line."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(2, 2, figsize=(9.6, 5.4), sharex="col", constrained_layout=True)
    for column, domain in zip(panels.T, ("kitchen", "open_cabinet"), strict=True):
        timestep = tracking.load(domain, "ee_delta_pose").control_timestep()
        for axis, colour in enumerate(COLOURS):
            line = tracking.follow_line(tracking.load(domain, "ee_delta_pose"), "ee_delta_pose", axis, 1)
            seconds = timestep * np.arange(1, len(line.angles) + 1)
            column[0].plot(seconds, 1e3 * line.offsets[:, 0], color=colour, label=f"{AXES[axis]} axis")
            column[1].plot(seconds, 1e3 * np.linalg.norm(line.offsets[:, 1:], axis=1), color=colour)
        column[0].plot(seconds, 1e3 * line.commanded, "k:", label="commanded")
        column[0].set_title(f"{domain}, ee_delta_pose")
        column[1].set_xlabel("time [s]")
    panels[0, 0].set_ylabel("along the line [mm]")
    panels[1, 0].set_ylabel("across the line [mm]")
    panels[0, 0].legend()
    for panel in panels.flat:
        panel.grid(alpha=0.3)
    figure.savefig(PICTURES / "control_modes_tracking.png", dpi=100)


def render_frames() -> None:
    """Renders the robot, transparent, with the axes of the frames `base` and `hand`."""
    sheet, see_through = [], wrapper.MjvOption()
    see_through.flags[mujoco.mjtVisFlag.mjVIS_TRANSPARENT] = True
    for domain, view in (("kitchen", (1.7, 60.0, -35.0)), ("open_cabinet", (1.7, 130.0, -20.0))):
        task = suite.DOMAINS[domain].default_task
        environment = suite.load(domain, task, {"random": 0, "control_mode": "ee_delta_pose"})
        environment.reset()
        hand, base = tracking.end_effector_pose(environment), tracking.base_pose(environment)

        def draw(physics: Any, scene: Any, shown: Any = (base, hand)) -> None:
            for position, orientation in shown:
                for axis in range(3):
                    add_arrow(scene, position, position + rotations.rotated(orientation, 0.35 * np.eye(3)[axis]), axis)

        camera = MovableCamera(environment.physics, 480, 480, max_geom=2000, scene_callback=draw)
        camera.set_pose((hand[0] + base[0]) / 2.0, *view)
        sheet.append(camera.render(scene_option=see_through))
    Image.fromarray(np.hstack(sheet)).save(PICTURES / "control_modes_frames.png", optimize=True)


def add_arrow(scene: Any, start: Any, end: Any, axis: int) -> None:
    """Adds an arrow of the axis' colour to a scene."""
    scene.ngeom += 1
    geom = scene.geoms[scene.ngeom - 1]
    colour = np.array(COLOURS[axis], np.float32)
    mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_ARROW, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
    mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_ARROW, 0.012, start, end)


# The grammar of generated kitchens. Nodes have a name, how they are drawn, a key of `DRAWN`, and their parts. Names of
# parts that may be missing end in "?".
WALL_ROW = (
    "row of wall cabinets",
    "row",
    ("wall_doors", "wall_sliding, at most 1", "hinge_cabinet, at most 1", "slide_cabinet, at most 1"),
)
BASE_ROW = ("row below the counter", "row", ("drawers", "base_doors", "stove, at most 1"))
# What may stand on each side of the robot, by what is before it.
BESIDE = {"oven": ("tall_door",), "cabinets": ("tall_door", "drawers", "base_doors")}
SIDES = {wall: ("left, right of the robot", "one", (", ".join(("nothing", *kinds)),)) for wall, kinds in BESIDE.items()}
GRAMMAR = (
    "kitchen",
    "all",
    (
        ("style", "one", (", ".join(STYLES),)),
        ("handle of all cabinets", "one", (", ".join(HANDLES),)),
        (
            "wall before the robot",
            "one",
            (
                ("oven wall", "all", ("oven", "kettle?", "hood?", WALL_ROW, SIDES["oven"])),
                ("cabinet wall", "all", (BASE_ROW, "microwave?", WALL_ROW[0], SIDES["cabinets"])),
            ),
        ),
    ),
)
# Colours of the lines, by how parts are drawn, and their meaning.
DRAWN = {
    "all": ("#404040", "-", "all of them"),
    "one": ("#0072B2", "--", "one of them"),
    "row": ("#009E73", ":", "some, side by side"),
}
# Distance between columns, and between lines [in].
COLUMN, LINE = 2.55, 0.34


def write_grammar_diagram() -> None:
    """Draws the grammar of generated kitchens as a tree, from left to right."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "grammar", "font.family": "sans-serif"})
    from matplotlib import lines, pyplot

    figure, panel = pyplot.subplots(figsize=(12.0, 5.6))
    height = _draw_node(panel, GRAMMAR, 0, 0.0)[1]
    panel.set(xlim=(-0.1, 5 * COLUMN - 0.4), ylim=(-height, 0.4))
    panel.axis("off")
    styles = [lines.Line2D([], [], color=color, linestyle=dash, label=words) for color, dash, words in DRAWN.values()]
    styles.append(lines.Line2D([], [], color="none", label="?  may be missing"))
    panel.legend(handles=styles, loc="upper right", frameon=False)
    figure.savefig(PICTURES / "kitchens_grammar.svg", bbox_inches="tight", metadata={"Date": None})
    pyplot.close(figure)


def _draw_node(panel: Any, node: Any, depth: int, top: float) -> tuple[float, float]:
    """Draws a node of the grammar below a height; returns the height of its middle, and where the next one begins."""
    name, how, parts = (node, "all", ()) if isinstance(node, str) else node
    middles, bottom = [], top
    for part in parts:
        middle, bottom = _draw_node(panel, part, depth + 1, bottom)
        middles.append(middle)
    middle, bottom = (np.mean(middles), bottom) if middles else (top + LINE / 2, top + LINE)
    x, (color, dash, _) = depth * COLUMN, DRAWN[how]
    for end in middles:
        way = [x + 0.2, x + COLUMN - 0.4, x + COLUMN - 0.4, x + COLUMN - 0.1], [-middle, -middle, -end, -end]
        panel.plot(*way, color=color, linestyle=dash, linewidth=1.2, zorder=1)
    edge = {"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": color if parts else "#b0b0b0"}
    panel.text(x, -middle, name, va="center", fontsize=10, bbox=edge)
    return float(middle), bottom


if __name__ == "__main__":
    made = {
        "all": write_pictures,
        "kitchens": write_kitchens_sheet,
        "objects": write_objects_sheet,
        "grammar": write_grammar_diagram,
        "controls": write_control_pictures,
    }
    parser = make_parser(__doc__)
    parser.add_argument("pictures", nargs="?", choices=made, default="all")
    made[parser.parse_args().pictures]()
