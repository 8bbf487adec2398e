"""Where the program ``rmem`` is."""

from __future__ import annotations

import os
import shutil
import sys
import sysconfig


def find_program() -> str:
    """Returns the path of the program ``rmem``.

    The environment variable ``RMEM_PROGRAM`` names it; else it is where the wheel put it, beside this Python's other
    scripts; else it is searched on PATH.

    Raises:
        FileNotFoundError: it is in none of these places.
    """
    named = os.environ.get("RMEM_PROGRAM")
    if named:
        return named
    folders = [sysconfig.get_path("scripts"), _user_scripts(), os.path.dirname(sys.executable)]
    for folder in folders:
        path = os.path.join(folder, "rmem")
        if os.access(path, os.X_OK) and os.path.isfile(path):
            return path
    found = shutil.which("rmem")
    if found:
        return found
    raise FileNotFoundError(
        "the program `rmem` is neither among this Python's scripts nor on PATH; install it with `pip install rmem`, "
        "or name it with the environment variable RMEM_PROGRAM"
    )


def _user_scripts() -> str:
    """Returns the folder of scripts that ``pip install --user`` fills."""
    return sysconfig.get_path("scripts", scheme=f"{os.name}_user")
