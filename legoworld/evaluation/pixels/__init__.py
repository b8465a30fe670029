"""Scoring of one array for each image: what every family of such answers shares."""
