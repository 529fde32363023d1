"""Commands for a running system: `call`, `skills`, `ps`, `stop`, `enable`, `host`, `certs`, `graph`."""
