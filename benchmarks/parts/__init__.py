"""What the studies beside this folder are made of; nothing here is a command."""
