"""Lightning callbacks: validation by succinctness and calibration, pictures, and what keeps a run safe."""
