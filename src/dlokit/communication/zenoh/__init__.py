"""The bus between processes, over zenoh."""
