"""What an analysis or a diagnosis says, as programs read it and as a person does; answers read again."""
