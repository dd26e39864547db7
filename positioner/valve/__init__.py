"""The valve as the controller knows it: parameters, motion, stem state, stiction table, credible values. Pure."""
