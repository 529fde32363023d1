"""What becomes of a running system when something of it fails."""
