"""Archives of strangers (zip, npz, HDF5), read within bounds of time and memory; nothing in them is run or unpacked."""
