"""What every picture shares: the meaning of each colour, lines and names in a panel, and how a picture is saved."""
