"""Problem files."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from . import _mpct
from ._mpct import Problem
from ._run import Simulation


def write_atomically(path: str | PathLike[str], data: bytes) -> None:
    """Writes a file as a whole: a temporary one beside it, then a rename."""
    path = Path(path)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        # A temporary file is readable by its owner alone; the result is as readable as any other file.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~mask)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise


@dataclass(frozen=True, eq=False)
class ProblemFile:
    """A problem and, when the file has a ``[simulation]``, what to simulate.

    Attributes
    ----------
    problem : Problem
        The problem.
    simulation : Simulation or None
        What to simulate.

    Examples
    --------
    >>> import mpct
    >>> file = mpct.example("academic")
    >>> run = file.simulation.run(file.problem.design().controller())
    >>> len(run) == file.simulation.steps
    True
    """

    problem: Problem
    simulation: Simulation | None = None

    @classmethod
    def read(cls, path: str | PathLike[str]) -> ProblemFile:
        """Reads a problem file.

        Parameters
        ----------
        path : str or os.PathLike
            A TOML file, as the command line reads it. Files that it names are looked up relative to it.

        Returns
        -------
        ProblemFile

        Raises
        ------
        FileError
            When the file cannot be read or has a key or value of the wrong kind.
        DesignError
            When the file is well formed, but what it states is not a problem.
        """
        return cls(*_mpct._read_file(path, None))

    @classmethod
    def parse(cls, text: str) -> ProblemFile:
        """Reads the text of a problem file.

        Parameters
        ----------
        text : str
            TOML text.

        Returns
        -------
        ProblemFile
        """
        return cls(*_mpct._read_file(None, text))

    def to_toml(self) -> str:
        """The text of a self-contained problem file that parses to the same.

        Returns
        -------
        str
        """
        return _mpct._write_file(self.problem, self.simulation)

    def write(self, path: str | PathLike[str]) -> None:
        """Writes the problem file as a whole or not at all.

        Parameters
        ----------
        path : str or os.PathLike
            Where.
        """
        write_atomically(path, self.to_toml().encode())


ProblemFile.__module__ = "mpct"
