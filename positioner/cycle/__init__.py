"""One control cycle: frames in, frames out, and all that is checked on the way. Pure."""
