"""The server of the page: addresses, access keys, files of the run."""
