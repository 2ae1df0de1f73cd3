"""Work on the processes of a Dask cluster: this machine's, a scheduler's, or batch jobs."""
