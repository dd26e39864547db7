"""The law `quasi-static`: moves that end where spring and sliding friction balance the pressure. Pure."""
