"""The figures of the paper for a run of one's own."""
