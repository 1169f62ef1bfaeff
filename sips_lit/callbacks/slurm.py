"""Jobs of Slurm that are started again: after a preemption, or to go on beyond their time limit."""

from __future__ import annotations

import os
import subprocess

SECONDS_TO_ANSWER = 30  # Slurm kills a job soon after it warned it


def in_job() -> bool:
    """Whether this process runs in a job."""
    return "SLURM_JOB_ID" in os.environ


def started_again() -> bool:
    """Whether Slurm has started this job before."""
    return os.environ.get("SLURM_RESTART_COUNT", "0") != "0"


def requeue() -> str:
    """Asks for another start of this job; returns what came of it, as the end of a sentence."""
    array = os.environ.get("SLURM_ARRAY_JOB_ID")
    job = os.environ["SLURM_JOB_ID"] if array is None else f"{array}_{os.environ['SLURM_ARRAY_TASK_ID']}"
    try:
        asked = subprocess.run(
            ["scontrol", "requeue", job], capture_output=True, text=True, timeout=SECONDS_TO_ANSWER, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"Slurm can't be asked to start job {job} again: {error}"
    if asked.returncode:
        return f"Slurm does not start job {job} again: {asked.stderr.strip() or f'exit code {asked.returncode}'}"
    return f"Slurm starts job {job} again"
