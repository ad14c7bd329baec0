"""The page in the browser: planners, regulators and simulators of some problems, as files that need no server."""
