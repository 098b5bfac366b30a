"""What a posed body covers in pictures, for `synthesis`, the evidence of silhouettes, and simulation."""
