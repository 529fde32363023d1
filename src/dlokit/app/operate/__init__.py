"""Commands for a system that runs: `call`, `skills`, `ps`, `stop`, `enable`, `host`, `certs`, `graph`."""
