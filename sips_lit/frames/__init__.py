"""Where images come from: folders, videos, simulated flights, demonstration data; as sequences and sources."""
