"""The on-board side: flies a plan by lease beside the autopilot, evades what is not in it, and reports."""
