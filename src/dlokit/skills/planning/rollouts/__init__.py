"""Actions chosen by playing candidates through in the model."""
