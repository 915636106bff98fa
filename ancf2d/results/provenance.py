"""Where a result comes from: versions, platform, moment, command."""

from __future__ import annotations

import hashlib
import platform
from datetime import UTC, datetime
from importlib import metadata

from ancf2d import __version__

PACKAGES = ("numpy", "scipy", "numba", "h5py")


def versions() -> dict[str, str]:
    """Return the versions that a result depends on, read without importing the packages."""
    found = {"ancf2d": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def provenance(case_text: str) -> dict[str, str]:
    """Return the root attributes that say when, where and with what a result was made."""
    found = {f"version_{name}": version for name, version in versions().items()}
    found["platform"] = platform.platform()
    found["created"] = datetime.now(UTC).isoformat(timespec="seconds")
    found["case_sha256"] = hashlib.sha256(case_text.encode("utf-8", "replace")).hexdigest()
    return found
