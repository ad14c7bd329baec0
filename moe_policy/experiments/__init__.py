"""The evidence: what scripts/ runs and results/ holds. Nothing but scripts and tests imports it."""
