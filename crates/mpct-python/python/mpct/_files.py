"""Problem files."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike

from . import _mpct
from ._atomic import write_atomically
from ._convert import instance
from ._mpct import Problem
from ._run import Simulation


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

    def __post_init__(self) -> None:
        instance(self.problem, Problem, "problem")
        if self.simulation is not None:
            instance(self.simulation, Simulation, "simulation")

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
