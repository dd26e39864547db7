"""Conformance tests: whether somebody else's node keeps the rules of docs/protocol.md, and how to correct it."""
