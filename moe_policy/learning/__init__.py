"""Clustering, training of networks and mixtures of experts."""
