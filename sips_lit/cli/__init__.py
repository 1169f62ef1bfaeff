"""The commands, one thin file each."""

import os

# Before torch is loaded: OpenMP threads that spin while they wait take the cores from the labelling threads, and make a
# training step on two cores up to five times as long.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
