"""The one error of the ply package."""


class PlyError(ValueError):
    """An argument that no ply can have, found where it enters the package.

    Attributes:
        argument: Name of the argument.
        problem: What is wrong with it, numbers included.
        remedy: What to change, or an empty string.
    """

    def __init__(self, argument: str, problem: str, remedy: str = "") -> None:
        """Join the parts into one line."""
        self.argument, self.problem, self.remedy = argument, problem, remedy
        super().__init__(f"{argument}: {problem}" + (f"; {remedy}" if remedy else ""))
