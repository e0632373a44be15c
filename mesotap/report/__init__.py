"""The pages of a session, a diagnosis and the theory, with their figures and templates."""
