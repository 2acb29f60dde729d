"""The project's benchmarks: what `gcs bench` runs."""
