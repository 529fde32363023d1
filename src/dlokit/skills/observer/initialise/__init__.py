"""The first shape: a cloud of unknown order becomes nodes, with no prior."""
