"""What a run stands on: devices, processes, threads, memory, time, progress and files."""
