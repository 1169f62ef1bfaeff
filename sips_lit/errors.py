"""Errors that are the user's to mend: the commands print them as one sentence and exit with 1."""


class BadInputError(ValueError):
    """Something given is unusable; the message says which file or key, what is wrong and what to do."""


class TrainingInterrupted(Exception):  # noqa: N818 - not an error: the user asked for it
    """Training stopped on request; the message says where it was saved."""
