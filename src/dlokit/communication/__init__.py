"""Publish/subscribe plus named skill calls: topics, skills, components, the host that wires them, transports."""
