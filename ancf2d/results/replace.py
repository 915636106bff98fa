"""Files that appear complete or not at all."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ancf2d.errors import ResultsError
from ancf2d.results.target import check_folder


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a private path beside ``path``; what is written there takes its place when the block ends well.

    Raises ResultsError where nothing can be written.
    """
    path = Path(path)
    check_folder(path)
    private = path.with_name(f".{path.name}.{os.getpid()}.{time.monotonic_ns()}.part")
    try:
        yield private
        with private.open("rb") as stream:
            os.fsync(stream.fileno())
        os.replace(private, path)
    except (OSError, RuntimeError) as error:  # h5py reports disk errors as either
        raise ResultsError(f"cannot write '{path}': {getattr(error, 'strerror', None) or error}") from error
    finally:
        with suppress(OSError):
            private.unlink()
