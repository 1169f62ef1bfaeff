"""Errors that are the user's to mend: the commands print them as one sentence and exit with 1."""


class BadInputError(ValueError):
    """Something given is unusable; the message says which file or key, what is wrong and what to do."""
