"""The session runner: states, legal transitions, and what each state does."""
