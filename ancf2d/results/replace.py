"""Files that appear complete or not at all."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ancf2d.errors import ResultsError
from ancf2d.results.target import check_output


@contextmanager
def replacing(path: str | os.PathLike[str], force: bool) -> Iterator[Path]:
    """Give a private path beside ``path``; what is written there takes its place when the block ends well.

    The private path has the same suffix. Raises ResultsError where nothing can be written, and where the file was not
    made by ancf2d, unless ``force``.
    """
    check_output(path, force)
    path = Path(path)
    private = path.with_name(f".{path.stem}.{os.getpid()}.{time.monotonic_ns()}.part{path.suffix}")
    try:
        yield private
        with private.open("rb") as stream:
            os.fsync(stream.fileno())
        check_output(path, force)  # it may have changed meanwhile
        os.replace(private, path)
    except (OSError, RuntimeError) as error:  # h5py reports disk errors as either
        raise ResultsError(f"cannot write '{path}': {getattr(error, 'strerror', None) or error}") from error
    finally:
        with suppress(OSError):
            private.unlink()
