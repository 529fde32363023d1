"""`dlokit bench latency`: how long it takes in a live run from the exposure of a picture to a decision, hop by hop."""
