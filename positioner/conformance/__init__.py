"""Whether somebody else's node keeps the rules of docs/protocol.md: the rules, what breaks them, and how to mend it."""
