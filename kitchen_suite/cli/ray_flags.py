"""The flags of command lines that can play on Ray."""

from absl import flags

from kitchen_suite.workers.cluster import Cluster


class RayFlags:
    """`--workers` and `--ray_address`."""

    def __init__(self, values: flags.FlagValues) -> None:
        """Defines them among a command's flags."""
        self._workers = flags.DEFINE_integer(
            "workers",
            None,
            "Processes on Ray that play the episodes; needs the extra ray. Default: this process plays them itself.",
            lower_bound=1,
            flag_values=values,
        )
        self._address = flags.DEFINE_string(
            "ray_address",
            None,
            "Ray cluster that the workers are on: HOST:PORT, ray://HOST:PORT, or auto for the one that this machine "
            "belongs to. Default: Ray is started here, and stopped at the end.",
            flag_values=values,
        )

    def cluster(self) -> Cluster | None:
        """The workers that are asked for.

        Raises:
          ImportError: Ray is missing.
          OSError: nothing answers at the address.
          ValueError: it is no address, or there is one but no number of workers.
        """
        if self._workers.value is None:
            if self._address.value is not None:
                raise ValueError("--ray_address needs --workers: the number of processes there")
            return None
        cluster = Cluster(workers=self._workers.value, address=self._address.value)
        cluster.check()
        return cluster
