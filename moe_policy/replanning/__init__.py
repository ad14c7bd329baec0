"""Plans that are renewed on the way."""
