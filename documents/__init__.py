"""The documents that are made from the code: the site, its reference, and the man pages. Not part of the package."""
