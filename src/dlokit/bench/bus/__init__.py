"""`dlokit bench bus`: messages and calls between two processes, beside bare zenoh and bare pyzmq in the same run."""
