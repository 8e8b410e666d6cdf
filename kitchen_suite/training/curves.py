"""Curves of a training run, in TensorBoard's event files."""

import os
import socket
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter


class CurveWriter:
    """Writes scalars to an event file.

    It writes in the calling thread. `torch.utils.tensorboard.SummaryWriter` writes in a thread of its own, which prints
    a traceback where the disk is full.
    """

    def __init__(self, folder: Path, *, first_step: int | None = None) -> None:
        """Opens a new file.

        Args:
          folder: of the file.
          first_step: TensorBoard then hides what earlier files in the folder hold from this step on.

        Raises:
          OSError: the file cannot be written.
        """
        seconds, nanoseconds = divmod(time.time_ns(), 10**9)
        name = f"events.out.tfevents.{seconds:010d}.{socket.gethostname()}.{os.getpid()}.{nanoseconds:09d}"
        self._writer = RecordWriter((folder / name).open("xb"))
        self._write(file_version="brain.Event:2")
        if first_step is not None:
            self._write(step=first_step, session_log=SessionLog(status=SessionLog.START))

    def write(self, scalars: Mapping[str, float], step: int) -> None:
        """Writes the values of curves, by name, at a step.

        Raises:
          OSError: the file cannot be written.
        """
        values = [Summary.Value(tag=name, simple_value=value) for name, value in scalars.items()]
        self._write(step=step, summary=Summary(value=values))

    def close(self) -> None:
        """Closes the file."""
        self._writer.close()

    def _write(self, **fields: Any) -> None:
        self._writer.write(Event(wall_time=time.time(), **fields).SerializeToString())
        self._writer.flush()
