"""Theory of the contact: stiffness against load."""
