"""Errors for malformed input; "unreachable" and "not proved" are results, never exceptions."""


class InputError(ValueError):
    """Input that cannot be used: the message names the field and what would be valid.

    Parameters
    ----------
    field
        Where the value was found, e.g. ``'arm.yaml: joints[2].alpha'``.
    problem
        What is wrong with it and what would be valid, as one clause.
    """

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f'{field}: {problem}')
        self.field = field
        self.problem = problem
