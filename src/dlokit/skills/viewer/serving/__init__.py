"""How the page is served: address, access keys, files of the run."""
