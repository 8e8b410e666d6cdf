"""The commands: a table of what each is, and `kitchen-suite`, which runs any of them.

Each is a console script, such as `kitchen-record`. From Python, `record.main(["--output=runs"])` runs it.
"""

import contextlib
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import kitchen_suite
from kitchen_suite import checks, files, settings
from kitchen_suite.commands.command import Command, fail, run_process
from kitchen_suite.rendering import gl

# Folder of the policies that come with the package, whose module imports dm_control.
_SHIPPED = Path(kitchen_suite.__file__).parent / "policies" / "trained_policies"


def _renders_by_default(given: settings.PlaySettings) -> bool:
    """Returns whether `kitchen-play` renders: what the policy sees, or a video, by default where one can be made."""
    if given.list:
        return False
    if given.video or _sees(given):
        return True
    if given.novideo or given.web:
        return False
    with contextlib.suppress(OSError):
        gl.find_library()
        return True
    return False


def _sees(given: settings.PlaySettings) -> bool:
    """Returns whether a policy takes pictures; that its file cannot be read is reported later."""
    shipped = _SHIPPED / f"{given.shipped}.npz"
    with contextlib.suppress(OSError):
        return bool(files.load_metadata(given.policy_file or shipped, "a trained policy").get("cameras"))
    return False


def _protocol_lines() -> str:
    from kitchen_suite.evaluation.protocols import PROTOCOLS

    names: dict[str, list[str]] = {"all domains": [], "the kitchen": []}
    for protocol in PROTOCOLS.values():
        names["all domains" if protocol.is_general else "the kitchen"].append(protocol.name)
    lines = (f"of {domains}: {', '.join(each)}" for domains, each in names.items())
    wrapper = textwrap.TextWrapper(settings.WIDTH, "  ", subsequent_indent=" " * 6, break_on_hyphens=False)
    return "\n".join(["", *map(wrapper.fill, lines), ""])


rollout = Command(
    name="kitchen-rollout",
    description="""Plays episodes of a task with a policy, and reports the results. Needs no display.

  kitchen-rollout                                          three episodes of random actions in the kitchen
  kitchen-rollout --list                                   domains, tasks and cameras
  kitchen-rollout --task_name=kettle --output=episodes     also writes each episode to a file
  kitchen-rollout --num_episodes=1 --video=kitchen.mp4     also films it
  kitchen-rollout --policy=expert --web=kitchen.html       completes the task, and writes a page that shows it in 3-D
  kitchen-rollout --policy=my_module:act                   acts as your own function of a dm_env.TimeStep does
  kitchen-rollout --policy=gym:my_module:act --obs_type=state    a function of Gymnasium's observation
  kitchen-rollout --workers=4 --num_episodes=100           plays on Ray, in four processes

Your own policy is a callable that takes a dm_env.TimeStep, or with gym: the observation of the Gymnasium environment,
and returns the action. Files are written atomically. Ctrl-C
keeps the finished episodes and the video until then. Exit status: 0; 1 if writing, the physics or the workers failed; 2
for a bad argument or policy, with one line on stderr; 130 if interrupted.
""",
    settings=settings.RolloutSettings,
    job="kitchen_suite.episodes.rollout_job:make_job",
    renders=lambda given: (given.video is not None or given.observes_pictures) and not given.list,
)

record = Command(
    name="kitchen-record",
    description="""Records episodes of a task, many at once, each from its own seed. Needs no display.

  kitchen-record --output=runs                                a hundred episodes of random actions in the kitchen
  kitchen-record --output=runs --task_name=kettle --seed=7    another task, other seeds
  kitchen-record --output=runs --dataset=me/kitchen-v0        also makes a Minari dataset of them
  kitchen-record --output=runs --format=lerobot --dataset=me/kitchen       or a LeRobot one: docs/guide/lerobot.md
  kitchen-record --output=runs --preset=random_order          demonstrations: four tasks in an order drawn at each reset
  kitchen-record --output=runs --num_episodes=1000            completes the recording that is in the folder
  kitchen-record --output=runs --workers=4                    plays on Ray, in four processes

Episode i of --seed=S has the seed S+i and does not depend on how many are played at once. Its file is written
atomically, so that an interrupt, even by kill -9, loses only the episodes in progress; the same command completes the
recording. A policy module:callable must be stateless, or be played with --num_envs=1. Exit status: 0; 1 if writing, the
physics or the workers failed; 2 for a bad argument or policy, with one line on stderr; 130 if interrupted.
""",
    settings=settings.RecordSettings,
    job="kitchen_suite.datasets.record_job:RecordJob",
    renders=lambda given: given.observes_pictures,
)

replay = Command(
    name="kitchen-replay",
    description="""Replays recorded actions, and checks that rewards and completions are identical. Needs no display.

  kitchen-replay runs                                     ten episodes of a folder of kitchen-record or kitchen-rollout
  kitchen-replay me/kitchen-v0                            of a Minari or LeRobot dataset
  kitchen-replay runs --episodes=all                      all episodes
  kitchen-replay runs --episodes=0,5,7-9 --video=a.mp4    also films them
  kitchen-replay runs --web=runs.html                     also writes a page that shows them in 3-D
  kitchen-replay D4RL/kitchen/complete-v2                 of a dataset of FrankaKitchen-v1

Exit status: 0 if all are equal; 1 if not, or if writing or the physics failed; 2 for a bad argument, with one line on
stderr; 130 if interrupted.
""",
    settings=settings.ReplaySettings,
    job="kitchen_suite.datasets.replay:ReplayJob",
    # A recording may hold pictures, which its replay renders again.
    renders=lambda given: True if given.video else None,
    positional="source",
)

play = Command(
    name="kitchen-play",
    description="""Plays a trained policy, and films it.

  kitchen-play                                               opens the drawer; the video is kitchen-play.mp4
  kitchen-play --shipped=top_drawer                          with the policy trained on the original reward
  kitchen-play --list                                        lists the policies that come with the package
  kitchen-play --policy_file=runs/drawer/policy.npz          with a policy written by kitchen-train
  kitchen-play --num_episodes=100 --novideo                  counts successes alone; needs no GL library
  kitchen-play --web=drawer.html                             a page to look at in 3-D; needs no GL library

The last line says how many episodes succeeded. Exit status: 0; 1 if writing or the physics failed; 2 for a bad
argument or policy file, with one line on stderr; 130 if interrupted.
""",
    settings=settings.PlaySettings,
    job="kitchen_suite.episodes.rollout_job:make_job",
    renders=_renders_by_default,
)

train = Command(
    name="kitchen-train",
    description="""Trains a policy by PPO on many environments at once. Needs no display, but the extra `train`.

  kitchen-train --output=runs/light --task_name=light_switch                      a task of the kitchen
  kitchen-train --output=runs/drawer --domain_name=open_cabinet                   the top drawer
  kitchen-train --output=runs/drawer --domain_name=open_cabinet --resume          continues that run
  kitchen-train --output=runs/kettle --task_name=kettle --demonstrations=kettle   clones a recording first
  kitchen-train --output=runs/more --task_name=kettle --initial_policy=runs/kettle/policy.npz
  tensorboard --logdir=runs                                                       shows the curves

The folder gets a folder for each seed: curves for TensorBoard, the last checkpoints, and `policy.npz`, the best policy
of all evaluations on held-out seeds; `kitchen-play --policy_file=...` plays it. A seed without progress is given up for
the next one. With --video, an episode of the best policy is filmed at the end. Exit status: 0; 1 if writing or the
physics failed, learning diverged, or no checkpoint can be read; 2 for a bad argument, with one line on stderr; 130 if
interrupted.
""",
    settings=settings.TrainSettings,
    job="kitchen_suite.training.train_job:TrainJob",
    renders=lambda given: given.video is not None or given.observes_pictures,
    needs=(("tensorboard", "torch"), "train"),
)

evaluate = Command(
    name="kitchen-evaluate",
    description="""Evaluates a policy under a published protocol, with confidence intervals. Needs no display.

  kitchen-evaluate --policy=expert                             200 episodes of random 4 of the kitchen's 7 tasks
  kitchen-evaluate --policy=expert --protocol=d4rl --json=expert.json --web=expert.html
  kitchen-evaluate --policy="trained(file='policy.npz')" --task_name=all --output=evaluation
  kitchen-evaluate --policy=expert --output=evaluation --resume    continues an evaluation that was interrupted
  kitchen-evaluate --policy=expert --receipt=expert.npz            also writes what kitchen-verify checks

Flags that are given replace the protocol's values, and the JSON has the final ones. The same evaluation has the same
JSON, to the byte, whatever --num_envs and --num_threads. A policy module:callable must be stateless, or be played with
--num_envs=1. Exit status: 0; 1 if writing failed; 2 for a bad argument or policy, with one line on stderr; 130 if
interrupted. Protocols, whose sources and values are in docs/guide/evaluation.md:
""",
    details=_protocol_lines,
    settings=settings.EvaluateSettings,
    job="kitchen_suite.evaluation.evaluate_job:EvaluateJob",
    renders=lambda given: given.observes_pictures,
)

verify = Command(
    name="kitchen-verify",
    description="""Plays the episodes of a receipt again, without the policy, and checks its scores. Needs no display.

  kitchen-evaluate --policy=expert --receipt=expert.npz    writes a receipt
  kitchen-verify expert.npz                                checks it

The actions are those of the receipt; seeds and settings make everything else anew. Exit status: 0 if all numbers are
equal to the bit; 3 if all scores are, but not all digits; 1 if scores differ, or if the file was changed or cannot be
read; 2 for a bad argument, with one line on stderr; 130 if interrupted.
""",
    settings=settings.VerifySettings,
    job="kitchen_suite.evaluation.verify_job:VerifyJob",
    positional="receipt",
)

benchmark = Command(
    name="kitchen-benchmark",
    description="""Measures speed and memory of the suite against bare MuJoCo and other implementations.

  kitchen-benchmark                                        ratios of control steps per second in the kitchen
  kitchen-benchmark --domain_name=open_cabinet --rounds=31
  kitchen-benchmark --measure=scaling --num_envs=1,8,32    by number of environments and threads, with memory
  kitchen-benchmark --measure=soak                         memory in the course of a million control steps
  kitchen-benchmark --measure=rendering                    frames per second by render quality, and what a frame costs

Machines are shared and noisy, so only ratios are comparable: in every round each case plays one episode with the same
actions, and its rate is divided by that of bare MuJoCo in the same round. The table has the median over the rounds.
Frames are compared with those of the original's renderer, or of `high` where a domain has no original; the best of
the rounds counts.
Exit status: 0; 2 for a bad argument, with one line on stderr; 130 if interrupted.
""",
    settings=settings.BenchmarkSettings,
    job="kitchen_suite.benchmarks.benchmark_job:BenchmarkJob",
    renders=lambda given: given.measure == "rendering",
)

certify = Command(
    name="kitchen-certify",
    description="""Certifies generated kitchens: builds each, measures it, and has the expert play every task in it.

  kitchen-certify                                             the first ten of the split train, to the cache folder
  kitchen-certify --split=test --designs=0:1000               others; continues where it was interrupted
  kitchen-certify --designs=0:200 --output=mine.jsonl         to a file of one's own
  kitchen-certify --designs=0:20 --output=mine.jsonl --check  certifies again, and compares

With the argument certified of the environments, episodes ask only for what the expert has completed. Exit status: 0; 1
if fixtures are in each other, a certificate does not hold, or writing failed; 2 for a bad argument, with one line on
stderr; 130 if interrupted, with all finished kitchens in the file.
""",
    settings=settings.CertifySettings,
    job="kitchen_suite.evaluation.certify_job:CertifyJob",
    renders=lambda given: False,
    needs=(("mink",), "experts"),
)

doctor = Command(
    name="kitchen-doctor",
    description="""Says what is installed and what works here: the text to paste into an issue. Needs no display.

  kitchen-doctor

The last lines have digests of episodes of each domain. Where they are known for the installed versions and this kind
of processor, they are compared. Exit status: 0, whatever is missing; 1 where a digest differs; 2 for a bad argument,
with one line on stderr; 130 if interrupted.
""",
    settings=settings.DoctorSettings,
    job="kitchen_suite.doctor:DoctorJob",
)

export = Command(
    name="kitchen-export",
    description="""Writes the scene of an episode as files that `mujoco` alone loads. Needs no display.

  kitchen-export --output=scene                                    the default kitchen
  kitchen-export --output=scene --domain_name=open_cabinet --control_mode=joint_position
  kitchen-export --output=scene --variations=layout,dynamics --seed=7
  kitchen-export --output=scene --variations=dynamics --variation_values='{"kettle/mass": 1.2}'

The folder gets scene.xml with its assets, scene.mjb, state.npz (the state after the reset of --seed), scene.json
(timesteps, actuators, meaning of the action, joints, cameras, values, licences) and README.md, which shows how to step
it. scene.mjb equals the environment's model to the bit. The command prints by how much scene.xml, once compiled,
differs from it. Exit status: 0; 1 if writing failed; 2 for a bad argument, with one line on stderr; 130 if interrupted.
""",
    settings=settings.ExportSettings,
    job="kitchen_suite.adapters.mjcf:ExportJob",
    renders=lambda given: given.observes_pictures,
)

convert = Command(
    name="kitchen-convert",
    description="""Converts recordings to datasets of other programs, and datasets to recordings.

  kitchen-convert runs --format=robomimic --dataset=me/set --data_path=data    as kitchen-record does, of a recording
  kitchen-convert data/me/set.hdf5 --output=back             makes the recording of such a dataset again, to the bit
  kitchen-convert kitchen_complete-v0.hdf5 --output=human    human demonstrations of the kitchen, in a file of D4RL
  kitchen-convert D4RL/kitchen/complete-v2 --output=human    human demonstrations in a Minari dataset

Of a dataset that kitchen-record or kitchen-convert made, the actions are played again from their seeds, and all numbers
compared. Human demonstrations are taken to ask for the tasks that they complete, by the suite's goals and thresholds,
in that order. D4RL's have no velocities; policies that are trained on them act on positions alone. Exit status: 0; 1 if
reading or writing failed, or an episode plays otherwise; 2 for a bad argument or data of another layout, with one line
on stderr; 130 if interrupted.
""",
    settings=settings.ConvertSettings,
    job="kitchen_suite.datasets.conversions:convert_job",
    # A recording may hold pictures, which are rendered again.
    renders=lambda given: None,
    positional="source",
)

view = Command(
    name="kitchen-view",
    description="""Shows episodes live in a browser on this machine. Needs no display, and no GL library.

  kitchen-view                                             the kitchen with random actions, at http://127.0.0.1:8080
  kitchen-view --policy=expert --task_name=kettle          the scripted expert moves the kettle
  kitchen-view --domain_name=open_cabinet --policy=trained
  kitchen-view --variations=layout,appearance --port=9000  every episode in another kitchen, at another port
  kitchen-view --teleop --task_name=kettle --output=mine   you move the hand, and save episodes as kitchen-record does

In the page, choose domain, task, policy, variations and seed; reset, pause, step and set the speed. Other machines are
refused; from one, use ssh -L 8080:localhost:8080 HOST. Exit status: 1 if the port is in use; 2 for a bad argument, with
one line on stderr; 130 after Ctrl-C, which ends the viewer.
""",
    settings=settings.ViewSettings,
    job="kitchen_suite.viewer.viewer:ViewJob",
    # A person sees pictures of the wrist where a GL library is installed.
    renders=lambda given: given.observes_pictures or (None if given.teleop else False),
    needs=(("viser", "mjviser"), "web"),
)

_ALL = (rollout, record, replay, play, train, evaluate, verify, certify, doctor, benchmark, export, convert, view)
COMMANDS: Mapping[str, Command] = MappingProxyType({each.name.removeprefix("kitchen-"): each for each in _ALL})


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command that the first argument names with the others, or lists all; returns the exit status."""
    name, *others = (sys.argv[1:] if arguments is None else arguments) or ["--help"]
    if name in ("--help", "-h"):
        print("kitchen-suite COMMAND [--help] runs one of the commands:\n")
        for each, command in COMMANDS.items():
            sentence = command.description.partition("\n")[0].partition(". ")[0]
            print(f"  {each:<10} {sentence.rstrip('.')}.")
        return settings.SUCCESS
    if name == "--version":
        print(f"kitchen-suite {kitchen_suite.__version__}")
        return settings.SUCCESS
    try:
        command = COMMANDS[checks.choice(name, COMMANDS, "command")]
    except ValueError as error:
        return fail("kitchen-suite", error, settings.USAGE)
    return command.main(others)


def console_main() -> int:
    """Runs `kitchen-suite` as a process of its own; returns the exit status."""
    return run_process("kitchen-suite", main)
