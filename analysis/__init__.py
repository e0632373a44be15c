"""From a session file to knowledge: modes, contact stiffness and damping, theory beside them."""
