"""The output folder of a run: every name inside it, what is finished, and how it is read back."""
