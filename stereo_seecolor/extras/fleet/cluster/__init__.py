"""Work on the processes of a Dask cluster: of this machine, of a scheduler that runs, or of jobs of
a batch system.
"""
