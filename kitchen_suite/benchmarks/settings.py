"""Settings of `kitchen-benchmark`."""

import dataclasses


@dataclasses.dataclass(frozen=True, kw_only=True)
class BenchmarkSettings:
    """Settings of `kitchen-benchmark`; each is the flag of its name.

    Attributes:
      num_envs: numbers of environments stepped together; the measure's default when empty.
      num_steps: control steps in total; the measure's default when omitted.
    """

    measure: str = "speed"
    domain_name: str = "kitchen"
    rounds: int = 9
    max_episode_steps: int | None = None
    num_envs: tuple[int, ...] = ()
    num_steps: int | None = None
    json: bool = False
