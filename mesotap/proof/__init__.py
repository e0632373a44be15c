"""The proof: sealed sessions in which something is concealed, a diagnosis that sees only them, and its score."""
