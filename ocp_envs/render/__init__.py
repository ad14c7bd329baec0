"""Pictures of states, trajectories and episodes."""
