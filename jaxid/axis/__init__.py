"""One machine axis as a file, and the `jaxid` command that works on it."""
