"""`legoworld view`: runs, trials and evaluations below a folder, in a browser, while they go on."""
