"""Records of results as JSON, and tables of them."""
