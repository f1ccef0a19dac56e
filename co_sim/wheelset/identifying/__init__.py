"""Identification on recorded data: logs from files, the banks on them, and what is written about it."""
