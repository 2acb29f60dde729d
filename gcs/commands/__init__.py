"""The commands of `gcs`, by what they are about."""
