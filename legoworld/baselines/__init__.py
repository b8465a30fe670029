"""Specialist models: started in processes of their own, or imported from their results."""
