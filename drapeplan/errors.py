"""Errors of drapeplan: each carries its data and knows its exit code."""

from __future__ import annotations

from typing import Any


class DrapeplanError(Exception):
    """Base of all errors that end a command with one clear line."""

    exit_code = 2

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel between processes as it is, however it was made."""
        return _restored, (type(self), self.args, self.__dict__)


class InputError(DrapeplanError):
    """Bad input: names the file, the key and the remedy.

    Attributes:
        source: File or argument that holds the mistake.
        key: Dotted key inside it, or an empty string.
        problem: What is wrong.
        remedy: What to change.
    """

    def __init__(self, source: str, key: str, problem: str, remedy: str = "") -> None:
        """Join the parts into one line."""
        self.source, self.key, self.problem, self.remedy = source, key, problem, remedy
        place = f"{source}: {key}" if key else str(source)
        super().__init__(f"{place}: {problem}" + (f"; {remedy}" if remedy else ""))


class InfeasibleError(DrapeplanError):
    """The scene is well posed and the answer is no.

    Attributes:
        what: The constraint, and the cup or joint that breaks it.
        excess: By how much, with its unit.
        remedy: What would help.
    """

    exit_code = 1

    def __init__(self, what: str, excess: str = "", remedy: str = "") -> None:
        """Join the parts into one line."""
        self.what, self.excess, self.remedy = what, excess, remedy
        parts = [what + (f" by {excess}" if excess else ""), remedy]
        super().__init__("; ".join(part for part in parts if part))


def _restored(
    kind: type[DrapeplanError], arguments: tuple[Any, ...], state: dict[str, Any]
) -> DrapeplanError:
    """An error as it left another process."""
    error = kind.__new__(kind, *arguments)
    error.__dict__.update(state)
    return error
