"""`dlokit bench observers`: compare all observers on the same clouds of rods with known nodes."""
