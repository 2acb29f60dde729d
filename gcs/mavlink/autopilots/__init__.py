"""The flight stacks: one class for each, which alone knows its quirks."""
