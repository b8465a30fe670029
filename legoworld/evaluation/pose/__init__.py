"""6D poses in BOP's folders: errors of estimates and their average recall."""
