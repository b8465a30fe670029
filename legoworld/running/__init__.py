"""Running a readout over a track: workers, resume, and the run folder."""
