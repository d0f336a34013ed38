"""Work that is done piece by piece, in processes of this machine or on a Dask cluster, and goes on where it was."""
