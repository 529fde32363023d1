"""A live system on several machines."""
