"""Files of a configuration: reading, writing and checking them before anything moves."""
