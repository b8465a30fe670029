"""Views of scenes as datasets in the formats of others."""
