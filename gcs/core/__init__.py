"""Words shared by all rooms: errors, frames, the scenario, the plan, missions and what is known of a vehicle."""
