"""The commands of `jaxid` on an axis, a module each: imports take longer than a short command."""
