"""The run folder as code: names, arrays, tables, checkpoints, checksums."""
