"""The folders legoworld writes and reads: runs, evaluations, comparisons."""
