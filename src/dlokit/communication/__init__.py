"""Publish/subscribe plus named skill calls: topics, skills, components, the container that wires them, transports."""
