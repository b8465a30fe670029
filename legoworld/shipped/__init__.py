"""What ships with the package: the catalogue's folders and the examples."""
