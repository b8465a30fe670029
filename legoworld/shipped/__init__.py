"""Files that ship with the package: the catalogue's folders and the examples."""
